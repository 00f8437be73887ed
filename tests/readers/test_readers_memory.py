"""Frames in memory, and trajectories given again."""

import numpy as np
import pytest

import atc
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units


def frame(k=0, name="metal"):
    return Frame(
        positions=np.full((3, 3), float(k)), cell=Cell([5.0, 6, 7]), units=units(name), types=[1, 2, 1], step=k
    )


def test_a_frame_and_lists_of_frames():
    f = frame()
    assert atc.read(f)[0] is f and len(atc.read(f)) == 1
    traj = atc.read([frame(k) for k in range(5)])
    assert [g.step for g in traj[::-2]] == [4, 2, 0]
    assert atc.read(f, masses=[2.0, 4.0])[0].masses.tolist() == [2, 4, 2] and f.masses is None
    assert traj.info()["frames"] == 5 and traj.info()["step"] == [0, 4]


def test_a_trajectory_given_again():
    traj = atc.read([frame(k) for k in range(5)])
    assert atc.read(traj) is traj
    other = atc.read(traj[1:3], masses={1: 3.0, 2: 5.0}, units="metal")
    assert len(other) == 2 and other[1].step == 2 and other[0].masses.tolist() == [3, 5, 3]
    with pytest.raises(AtcError, match="was opened in 'metal' units but the units argument says 'real'"):
        atc.read(traj, units="real")
    with pytest.raises(AtcError, match="has its topology"):
        atc.read(traj, topology="x")


def test_what_does_not_fit():
    with pytest.raises(AtcError, match="frame 1 of the list has units 'lj', the first 'metal'"):
        atc.read([frame(), frame(name="lj")])
    with pytest.raises(AtcError, match="item 1 of the list is a int, expected a Frame"):
        atc.read([frame(), 3])
    with pytest.raises(AtcError, match="the frames are in 'metal' units but the units argument says 'real'"):
        atc.read(frame(), units="real")
    with pytest.raises(AtcError, match="carry their topology themselves"):
        atc.read(frame(), topology="x.data")
