"""The notebooks run from top to bottom, and what they claim is what they show."""

import re
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).resolve().parent.parent / "notebooks"


def run(name):
    notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
    # Any exception in a cell is raised here, with the cell and its traceback.
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(NOTEBOOKS)}}).execute()
    return notebook


def printed(notebook):
    return "".join(
        o.text for c in notebook.cells if c.cell_type == "code" for o in c.outputs if o.output_type == "stream" and o.name == "stdout"
    )


def test_every_notebook_is_tested():
    assert [p.name for p in NOTEBOOKS.glob("*.ipynb")] == ["hardy_vs_virial.ipynb"]


def test_hardy_vs_virial(monkeypatch):
    # The notebook's own backend, which keeps the pictures in it.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = run("hardy_vs_virial.ipynb")
    assert not [o for c in notebook.cells if c.cell_type == "code" for o in c.outputs if o.output_type == "stream" and o.name == "stderr"]
    text = printed(notebook)
    far, peak = map(float, re.search(r"far from the hole ([\d.]+) GPa; largest on this line: Hardy ([\d.]+)", text).groups())
    # Elasticity says 3 at the rim of a small hole; a kernel half as wide as the hole takes some of that away.
    assert 1.5 < peak / far < 3.5
    differences = [float(x) for x in re.findall(r"GPa +([\d.]+) %", text)]
    assert len(differences) == 5
    # "The difference falls as the kernel gets wider than the bonds": from 4 to 16 angstrom by much more than the radius itself.
    assert differences[0] > 4 * differences[-1] > 0
    sums = [float(x) for x in re.findall(r"relative difference ([\d.e+-]+)", text)]
    # The mean over points 2 angstrom apart against the exact integral: limited by how the grid resolves the kernel, better for wider ones.
    assert len(sums) == 3 and sums[0] < 1e-2 and sums[-1] < sums[0]
    assert sum(o.output_type == "display_data" for c in notebook.cells if c.cell_type == "code" for o in c.outputs) == 3
