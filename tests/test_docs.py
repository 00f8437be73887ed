"""The pages of docs/: what their Python snippets print is what stands below them, and their links lead somewhere."""

import contextlib
import io
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from atc.cli import app

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
SNIPPET = re.compile(r"^```python\n(.*?)^```$(?:\n\n```text\n(.*?)^```$)?", re.MULTILINE | re.DOTALL)
#: Those whose snippets say what they print; others show a call on files of the reader's own.
PAGES = [p for p in sorted(DOCS.rglob("*.md")) if any(text for _, text in SNIPPET.findall(p.read_text()))]
#: Pages that run LAMMPS for minutes.
LONG = {"slit_flow.md"}
#: Pages whose commands are carried out, too, in the order of the page.
TRIED = {"wire.md", "files.md"}
BLOCK = re.compile(r"^```(python|console)\n(.*?)^```$(?:\n\n```text\n(.*?)^```$)?", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def same(printed: str, written: str) -> bool:
    """Equal words, and numbers that differ by no more than two units of the last digit written."""
    if NUMBER.sub("#", printed) != NUMBER.sub("#", written):
        return False
    for a, b in zip(NUMBER.findall(printed), NUMBER.findall(written), strict=True):
        mantissa, _, exponent = b.partition("e")
        unit = 10.0 ** (-len(mantissa.partition(".")[2]) + int(exponent or 0))
        if not abs(float(a) - float(b)) <= 2.001 * unit:
            return False
    return True


def test_every_tutorial_is_run():
    assert {p.name for p in PAGES} == {"quick_start.md", *(p.name for p in (DOCS / "tutorials").iterdir())}


def test_what_counts_as_the_same():
    assert same("a 1.23 b", "a 1.24 b") and same("x 2e-05", "x 3e-05") and same("11 mm", "12 mm")
    assert not same("a 1.23 b", "a 1.26 b") and not same("a 1", "b 1") and not same("1 2", "1") and not same("nan", "1")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=pytest.mark.slow) if p.name in LONG else p for p in PAGES],
    ids=lambda p: p.relative_to(DOCS).as_posix(),
)
def test_snippets(page, tmp_path, monkeypatch):
    if re.search(r"^(import lammps|from lammps)", page.read_text(), re.MULTILINE):
        from lammps_oracle import _load_mpi

        _load_mpi()
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for kind, code, written in BLOCK.findall(page.read_text()):
        if kind == "console":
            for line in code.splitlines() if page.name in TRIED else ():
                assert line.startswith("$ atc "), line
                done = CliRunner().invoke(app, shlex.split(line)[2:])
                assert done.exit_code == 0, f"{page}: {line}\n{done.output}"
                assert "warning" not in done.output, f"{page}: {line}\n{done.output}"
            continue
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(code, str(page), "exec"), names)
        assert same(out.getvalue().strip(), written.strip()), f"{page}: {code}\nprinted:\n{out.getvalue()}"


def slug(heading: str) -> str:
    """As Markdown's table of contents makes it."""
    text = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading)
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", text).strip().lower())


@pytest.mark.parametrize(
    "page",
    [*sorted(DOCS.rglob("*.md")), *(ROOT / n for n in ("README.md", "CONTRIBUTING.md", "data/README.md"))],
    ids=lambda p: p.relative_to(ROOT).as_posix(),
)
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        file, _, anchor = target.partition("#")
        there = (page.parent / file) if file else page
        assert there.exists(), f"{page.name}: {target}"
        if anchor and there.suffix == ".md":
            headings = re.findall(r"^#+ (.*)$", there.read_text(), re.MULTILINE)
            assert anchor in map(slug, headings), f"{page.name}: {target}"


def test_every_page_is_in_the_navigation():
    listed = set(re.findall(r": ([\w/]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE))
    assert listed == {p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md")}
