"""One million nodes through `atc pd`: peak memory, opt-in."""

import subprocess
import sys

import pytest

SCRIPT = """
import resource, sys
from atc.case import Case
n = 100
case = Case.load({
    "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [n - 0.9] * 3}, "spacing": 1.0, "horizon": 3.01, "density": 1.0},
    "material": {"model": sys.argv[1], "youngs": 1.0, **({} if sys.argv[1] == "pmb" else {"poisson": 0.3})},
    "damage": {"s00": 0.02}, "contact": {}, "initial": {"velocity": ["1e-3*x", 0, 0]}, "run": {"steps": 2}, "output": {"every": 1},
})
ds = case.run(sys.argv[2], threads=2)
assert ds.sizes["node"] == n**3 and ds.attrs["bonds"] > 58_000_000
print("GB", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)
"""


@pytest.mark.slow
@pytest.mark.parametrize("model", ["pmb", "lps"])
def test_a_million_nodes_take_less_than_six_gigabytes(tmp_path, model):
    out = subprocess.run([sys.executable, "-c", SCRIPT, model, str(tmp_path / "out.zarr")], capture_output=True, text=True, check=True).stdout
    gigabytes = float(out.split("GB")[1])
    print(f"{model}: {gigabytes:.2f} GB")
    assert gigabytes < 6.0
