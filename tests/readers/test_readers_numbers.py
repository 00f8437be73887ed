"""The kernels under the readers: numbers from text, lines, sorting, resolution. Python's own float(), int() and
sorted() are the oracles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atc.readers import _parse
from atc.readers.resolution import decimal_resolution, text_resolution


def parse(tokens, cap=None):
    """Numbers of one-column lines through the kernel, and how many of them it left to Python."""
    data = ("\n".join(tokens) + "\n").encode()
    buf = np.frombuffer(data, np.uint8)
    n = len(tokens)
    floats, ints, texts = np.empty((n, 1)), np.empty((n, 0), np.int64), np.empty((n, 0, 2), np.int64)
    hard = np.empty((cap or n + 1, 4), np.int64)
    kind, slot = np.array([_parse.FLOAT]), np.array([0])
    status, row, pos, left = _parse.FULL, 0, 0, 0
    while status == _parse.FULL:
        status, row, pos, m = _parse.parse_table(buf, pos, kind, slot, row, n, floats, ints, texts, hard)
        left += m
        for r, _, a, b in hard[:m].tolist():
            floats[r, 0] = float(data[a:b])
    assert (status, row, pos) == (_parse.DONE, n, len(data))
    return floats[:, 0], left


def assert_same_bits(tokens, most_left=None):
    got, left = parse(tokens)
    want = np.array([float(t) for t in tokens])
    bad = np.flatnonzero(got.view(np.uint64) != want.view(np.uint64))
    assert not len(bad), [(tokens[k], got[k], want[k]) for k in bad[:5]]
    if most_left is not None:
        assert left <= most_left * len(tokens)


N = 400_000


def test_shortest_representations_of_any_double():
    bits = np.random.default_rng(0).integers(0, 2**64, N, dtype=np.uint64).view(np.float64)
    # Subnormal numbers and a few undecided ones go to Python: 1 % at most.
    assert_same_bits([repr(x) for x in bits[np.isfinite(bits)].tolist()], 0.01)


@pytest.mark.parametrize("form", ["%g", "%.8f", "%.15g", "%.16g", "%.17g", "%.16e", "%.3f", "%.12e"])
def test_printed_coordinates(form):
    x = np.random.default_rng(1).normal(size=N // 4) * 10.0 ** np.random.default_rng(2).integers(-6, 7, N // 4)
    assert_same_bits([form % v for v in x.tolist()], 0.001)


def test_half_way_between_two_doubles():
    """The hardest cases: decimal numbers exactly between neighbouring doubles, and one unit of the last digit
    beside."""
    m = np.random.default_rng(3).integers(2**52, 2**53, 20000).tolist()
    assert_same_bits([f"{k}.5" for k in m])
    assert_same_bits([str(2 * k + 1) for k in m])
    assert_same_bits([f"{2 * k + 1}.0000000001" for k in m])
    assert_same_bits([str(4 * k + 2 + d) for k in m[:5000] for d in (-1, 0, 1)])


def test_odd_but_legal():
    tokens = "0 -0 +1 1. .5 -.5e1 1E5 1e+5 1e-05 007 1e22 1e23 1e-22 1e308 1.7976931348623157e308 2.2250738585072014e-308 5e-324 1e400 -1e400 nan -nan inf 0e999 0.0000000000000000000000000001 123456789012345678901234567890".split()
    assert_same_bits(tokens)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.from_regex(r"\A[-+]?[0-9]{1,25}(\.[0-9]{0,25})?([eE][-+]?[0-9]{1,3})?\Z"), min_size=1, max_size=20))
def test_any_decimal_number(tokens):
    assert_same_bits(tokens)


def test_resuming_when_the_list_of_hard_ones_is_full():
    tokens = ["1.5", "1e400", "2.5", "nan", "3.5", "1e-400"] * 50
    got, left = parse(tokens, cap=3)
    assert left == 150
    np.testing.assert_array_equal(got, [float(t) for t in tokens])


def test_columns_integers_words_and_faulty_lines():
    kinds, slots = np.array([_parse.INT, _parse.TEXT, _parse.FLOAT]), np.array([0, 0, 0])

    def run(text):
        buf = np.frombuffer(text.encode(), np.uint8)
        n = text.count("\n")
        out = np.zeros((n, 1)), np.zeros((n, 1), np.int64), np.zeros((n, 1, 2), np.int64)
        hard = np.zeros((10, 4), np.int64)
        return *_parse.parse_table(buf, 0, kinds, slots, 0, n, *out, hard), out, hard

    text = "12 Si 1.5\n \t-7\tGe  2.5 \r\n9223372036854775807 O 3\n"
    status, _row, pos, left, (f, i, t), hard = run(text)
    assert (status, pos, left) == (_parse.DONE, len(text), 1)
    assert hard[0].tolist() == [2, 0, text.index("9223"), text.index(" O")]  # 19 digits may not fit: Python decides
    np.testing.assert_array_equal(f[:, 0], [1.5, 2.5, 3])
    assert i[:2, 0].tolist() == [12, -7]
    assert [text[a:b] for a, b in t[:, 0].tolist()] == ["Si", "Ge", "O"]
    assert run("1 a 2\n1 a\n3 b 4\n")[:2] == (_parse.SHORT, 1)
    assert run("1 a 2\n1 a 2 3\n3 b 4\n")[:2] == (_parse.LONG, 1)
    assert run("1 a 2\n\n3 b 4\n")[:2] == (_parse.SHORT, 1)
    for word in ("1.5", "x", "1x", "-", "0x10"):
        assert run(f"{word} a 2\n")[3] == 1
    for word in ("1.5.2", "e5", ".", "-", "1e", "1e+", "1,5", "12abc"):
        assert run(f"1 a {word}\n")[3] == 1


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, 9000), max_size=6), st.integers(0, 8), st.booleans())
def test_skipping_lines(lengths, n, ended):
    text = b"\n".join(b"x" * k for k in lengths) + (b"\n" if ended else b"")
    ends = [k + 1 for k, c in enumerate(text) if c == 10]
    pos, seen = _parse.skip_lines(np.frombuffer(text, np.uint8), n)
    if n <= len(ends):
        assert (pos, seen) == (ends[n - 1] if n else 0, n)
    else:
        assert (pos, seen) == (len(text), len(ends))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(-50, 10**6) | st.integers(1, 60), min_size=1, max_size=50))
def test_sorting(ids):
    ids = np.array(ids)
    order = np.empty(len(ids), np.int64)
    state, row = _parse.sorting(ids, order)
    if state == 0:
        assert (np.diff(ids) > 0).all()
    elif state == 1:
        assert ids[order].tolist() == sorted(set(ids.tolist())) == sorted(ids.tolist())
    elif state == 2:
        assert ids[row] in ids[:row]
    else:
        assert np.ptp(ids) >= 8 * len(ids)


@pytest.mark.parametrize(
    "form,want", [("%g", 1e-4), ("%.3f", 1e-3), ("%.10g", 1e-8), ("%.17g", 1.4210854715202004e-14), ("%.5e", 1e-4)]
)
def test_resolution_of_text(form, want):
    x = np.random.default_rng(0).uniform(0, 99, 900)
    resolution, _ = text_resolution([form % v for v in x])
    assert resolution == pytest.approx(want)


def test_resolution_of_numbers():
    x = np.random.default_rng(0).uniform(0, 99, (300, 3))
    assert decimal_resolution(np.round(x, 3))[0] == pytest.approx(1e-3)
    assert decimal_resolution(x)[0] == np.spacing(x.max())
    assert decimal_resolution(x.astype(np.float32))[0] == np.spacing(np.float32(x.max()))
    # nanometres with three decimals that became ångström in float32, as XTC and GRO files do
    assert decimal_resolution(np.round(x / 10, 3).astype(np.float32) * np.float32(10))[0] == pytest.approx(0.01)
    assert decimal_resolution(np.zeros((5, 3)))[0] == 0


@pytest.mark.parametrize("spacing", [1.0, 2.0, 1.805, 2.5])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_perfect_lattice_is_not_rounded(spacing, kind):
    x = (np.indices((8, 8, 8)).reshape(3, -1).T * spacing).astype(kind)
    got, why = decimal_resolution(x)
    assert got <= np.spacing(np.float32(x.max())) and "decimals" not in why
    shaken = np.round(x + np.random.default_rng(1).normal(0, 0.1, x.shape), 2)
    assert decimal_resolution(shaken)[0] == pytest.approx(0.01)


@pytest.mark.parametrize("spacing, shift", [(2.0, 0), (2.5, 0), (1.805, 0), (1.0, 0.5), (0.125, 0)])
def test_text_of_a_perfect_lattice_says_nothing(spacing, shift):
    x = ((np.indices((6, 6, 6)).reshape(3, -1).T + shift) * spacing).ravel()
    resolution, why = text_resolution([f"{v:g}" for v in x])
    assert resolution == 0 and "lattice" in why
    # what a format drops no zeros from shows it, and so do digits that the lattice constant does not have
    assert text_resolution([f"{v:.3f}" for v in x])[0] == pytest.approx(1e-3)
    assert text_resolution([f"{v * np.sqrt(3):g}" for v in x])[0] == pytest.approx(10.0 ** (np.floor(np.log10(x.max() * np.sqrt(3))) - 5))  # fmt: skip
    # warm atoms written with few digits are no lattice
    shaken = x + np.random.default_rng(1).normal(0, 0.1, x.shape)
    assert text_resolution([f"{v:.2f}" for v in shaken])[0] == pytest.approx(0.01)
    assert text_resolution([f"{v:.3g}" for v in shaken])[0] == pytest.approx(10.0 ** (np.floor(np.log10(shaken.max())) - 2))  # fmt: skip


def dump_text(frames, form, scaled):
    out = []
    for k, x in enumerate(frames):
        s, names = (x / 16, "xs ys zs") if scaled else (x, "x y z")
        rows = "".join(f"{n + 1} 1 {' '.join(form % c for c in r)}\n" for n, r in enumerate(s))
        out.append(
            f"ITEM: TIMESTEP\n{k}\nITEM: NUMBER OF ATOMS\n{len(x)}\nITEM: BOX BOUNDS pp pp pp\n" + "0 16\n" * 3
            + f"ITEM: ATOMS id type {names}\n" + rows
        )  # fmt: skip
    return "".join(out)


@pytest.mark.parametrize("kind", ["dump", "scaled", "xyz", "files"])
def test_resolution_where_atoms_start_on_a_lattice(tmp_path, kind):
    import atc

    lattice = np.indices((8, 8, 8)).reshape(3, -1).T * 2.0
    warm = lattice + np.random.default_rng(2).normal(0.5, 0.05, lattice.shape)

    def read(frames):
        if kind == "xyz":
            text = "".join(
                f'{len(x)}\nLattice="16 0 0 0 16 0 0 0 16" Properties=species:S:1:pos:R:3\n'
                + "".join(f"Ar {a:g} {b:g} {c:g}\n" for a, b, c in x)
                for x in frames
            )
            (tmp_path / "run.xyz").write_text(text)
            return atc.read(tmp_path / "run.xyz", units="metal")
        if kind == "files":
            paths = [tmp_path / f"run{k}.dump" for k in range(len(frames))]
            for path, x in zip(paths, frames):
                path.write_text(dump_text([x], "%g", False))
            return atc.read(paths if len(paths) > 1 else paths[0], units="metal")
        (tmp_path / "run.dump").write_text(dump_text(frames, "%g", kind == "scaled"))
        return atc.read(tmp_path / "run.dump", units="metal")

    alone = read([lattice]).info()
    assert alone["coordinate_resolution"] == 0 and "unknown" in alone["coordinate_resolution_from"]
    later = read([lattice, lattice, lattice, warm]).info()
    want = 16e-6 if kind == "scaled" else 1e-4
    assert later["coordinate_resolution"] == pytest.approx(want)
    assert "6 significant digits" in later["coordinate_resolution_from"]


def test_fields_of_a_run_that_starts_on_a_lattice(tmp_path):
    """The doubt that rounding leaves is that of the digits of a later frame; before they were known, of a whole 2 Å."""
    import atc

    lattice = np.indices((6, 6, 6)).reshape(3, -1).T * 2.0
    warm = lattice + np.random.default_rng(2).normal(0.5, 0.05, lattice.shape)
    kernel, grid = atc.kernel("quartic", 4.0), atc.Grid.points([[3, 4, 5], [7, 8, 9]])
    for frames, found in (([lattice], None), ([lattice, warm], 1e-4)):
        (tmp_path / "run.dump").write_text(dump_text(frames, "%g", False))
        traj = atc.read(tmp_path / "run.dump", units="metal", masses=[40.0])
        ds = atc.fields(traj, None, kernel, grid, ["density"], tolerance=1e-6)
        assert ds.density.attrs.get("input_error", 0) < 1e-3, found
        assert ("input_error" in ds.attrs) == (found is not None)


# --- the first few numbers of a process, which Python reads

ODD = [
    "-0",
    "+7",
    "007",
    "1e400",
    "nan",
    "inf",
    "1_0",
    "1.5.2",
    "e5",
    "-",
    "1e5",
    "12345678901234567890",
    ".5",
    "5.",
    "x",
]
ODD += ["0.1e-400", "4.9e-324", "1.7976931348623157e308", "--1", "1e", "\u0661", "9007199254740993", "1\x0b2"]


def both(data, kinds, n, monkeypatch):
    """What either parser makes of a table, with what it leaves to Python: (status, row, pos), numbers as bits, words that
    are none; and how many it let Python read at once."""
    out = []
    for spent in (0, _parse.FIRST_BY_PYTHON):
        monkeypatch.setattr(_parse, "_by_python", spent)
        floats, ints = np.zeros((n, kinds.count(0))), np.zeros((n, kinds.count(1)), np.int64)
        texts, hard = np.zeros((n, 0, 2), np.int64), np.zeros((4 * n * len(kinds) + 4, 4), np.int64)
        slots, wrong = [kinds[:k].count(kind) for k, kind in enumerate(kinds)], []
        *found, left = _parse.read_table(
            np.frombuffer(data, np.uint8), 0, np.array(kinds), np.array(slots), 0, n, floats, ints, texts, hard
        )
        for r, c, a, b in hard[:left].tolist():
            try:
                (ints if kinds[c] else floats)[r, slots[c]] = (int if kinds[c] else float)(data[a:b])
            except (ValueError, OverflowError):
                wrong.append((r, c, data[a:b]))
        out += [(found, floats.view(np.uint64).tolist(), ints.tolist(), wrong), _parse._by_python - spent]
    return out


def test_python_reads_the_same_numbers(monkeypatch):
    rng = np.random.default_rng(7)
    a, b, c, d = rng.normal(size=500), rng.normal(size=500), rng.integers(-9, 9, 500), rng.normal(size=500) * 1e-9
    numbers = zip(a.tolist(), b.tolist(), c.tolist(), d.tolist())
    rows = [f"{k} {a!r} {b:.6g}\t{c:+d}  {d:.3e}\r\n" for k, (a, b, c, d) in enumerate(numbers)]
    plain, taken, compiled, none = both("".join(rows).encode(), [1, 0, 0, 1, 0], 500, monkeypatch)
    assert plain == compiled and taken == 2500 and none == 0


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("odd", ODD)
def test_what_is_no_plain_number_is_as_the_compiled_parser_has_it(odd, kind, monkeypatch):
    plain, _, compiled, _ = both(f"1 2\n{odd} 3\n4 5\n".encode(), [kind, 0], 3, monkeypatch)
    assert plain == compiled


@pytest.mark.parametrize("lines", ["1 2\n3\n4 5\n", "1 2\n3 4 5\n6\n", "\n1 2\n3 4\n", "1 2\n3 4\n5 6"])
def test_lines_of_another_width_are_found_by_both(lines, monkeypatch):
    n = lines.count("\n")
    plain, taken, compiled, _ = both(lines.encode(), [0, 0], n, monkeypatch)
    assert plain == compiled and taken == (0 if n == 3 else 4)
