"""Fields as an MDAnalysis analysis: `Fields(universe.atoms, ...).run(start, stop, step)`, results as they are there."""

from __future__ import annotations

import numpy as np
from MDAnalysis.analysis.base import AnalysisBase

from ..errors import AtcError
from ..running.run import fields


class Fields(AnalysisBase):
    """Continuum fields of an AtomGroup's trajectory.

    Parameters
    ----------
    atoms : Universe or AtomGroup, in MDAnalysis's units (Å, ps, kJ/mol); bonds may not lead out of it
    pot, kern, grid, quantities, tolerance : as for `atc.fields`; lengths in Å
    verbose : a progress bar
    **options : whatever else `atc.fields` takes (method, average, reference, out, …)

    Attributes
    ----------
    results.dataset : xarray.Dataset, as `atc.fields` gives it
    results.<quantity> : its values (frame, …), and of averages ``<quantity>_stderr``
    results.units : {quantity: unit}
    frames, times, n_frames, start, stop, step : what was analysed (times in ps)

    Raises
    ------
    AtcError : as `atc.fields`; for a backend other than serial, multiprocessing and dask

    Notes
    -----
    `run(backend="multiprocessing", n_workers=N)` spreads frames over N processes, as `atc.fields(workers=N)`; with
    ``backend="dask"`` the address of the scheduler is the option `cluster`.
    """

    @classmethod
    def get_supported_backends(cls):
        """The names that `run(backend=...)` takes."""
        return ("serial", "multiprocessing", "dask")

    _analysis_algorithm_is_parallelizable = True

    def __init__(
        self, atoms, pot=None, kern=None, grid=None, quantities=("stress",), tolerance=1e-5, verbose=False, **options
    ):
        self.atoms = atoms.atoms
        super().__init__(self.atoms.universe.trajectory, verbose=verbose)
        self._what = (pot, kern, grid, quantities, tolerance)
        self._options = options

    def run(
        self,
        start=None,
        stop=None,
        step=None,
        frames=None,
        verbose=None,
        n_workers=None,
        n_parts=None,
        backend=None,
        *,
        unsupported_backend=False,
        progressbar_kwargs=None,
    ):
        """Compute the fields of the frames `start:stop:step`, or of those that `frames` numbers. Returns itself."""
        from .. import read

        backend = backend or "serial"
        if backend not in self.get_supported_backends():
            raise AtcError(f"backend {backend!r}: expected one of {', '.join(self.get_supported_backends())}")
        # The analysis of MDAnalysis moves the trajectory to its last frame; what is asked for is found without that.
        self._setup_frames(self._trajectory, start, stop, step, frames)
        traj = read(self.atoms)
        if frames is None:
            chosen = traj[slice(start, stop, step)]
        else:
            numbers = np.arange(len(traj))[np.asarray(frames)]
            chosen = [traj[int(k)] for k in numbers]
        options = dict(self._options)
        if backend == "multiprocessing":
            options["workers"] = n_workers or options.get("workers", 1)
        elif backend == "dask" and not options.get("cluster"):
            raise AtcError('backend "dask": give the address of its scheduler: Fields(..., cluster="tcp://host:port")')
        show = self._verbose if verbose is None else verbose
        bar = None
        if show:
            from MDAnalysis.lib.log import ProgressBar

            bar = ProgressBar(total=self.n_frames, **(progressbar_kwargs or {}))
            options["progress"] = lambda done, total, rate: bar.update(done - bar.n)
        try:
            ds = fields(chosen, *self._what, **options)
        finally:
            if bar is not None:
                bar.close()
        self.frames = np.arange(len(self._trajectory))[slice(start, stop, step) if frames is None else frames]
        self.times = np.array([self._trajectory[int(k)].time for k in self.frames])
        self.results.dataset = ds
        self.results.units = {name: str(da.attrs.get("units", "")) for name, da in ds.data_vars.items()}
        for name, da in ds.data_vars.items():
            self.results[name] = da.values
        return self
