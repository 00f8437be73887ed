"""What pyproject.toml declares as the lowest versions is what CI installs and tries."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent


def numbers(version):
    n = [int(k) for k in version.split(".")]
    while n and n[-1] == 0:
        n.pop()
    return n


def test_the_lowest_versions_are_tried():
    declared = dict(
        re.fullmatch(r"([\w-]+)>=([\d.]+)", d).groups()
        for d in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    )
    tried = dict(line.split("==") for line in (ROOT / "tests" / "lowest.txt").read_text().split("\n") if "==" in line)
    assert set(tried) == set(declared)
    for name, version in declared.items():
        # 1.11 is tried as 1.11.1 where the registry has no wheel of 1.11.0
        assert numbers(tried[name])[: len(numbers(version))] == numbers(version), name
