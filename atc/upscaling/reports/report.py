"""A report that goes through a paper's claims: what was measured, and whether it reproduces. HTML with pictures beside
it, and the numbers as JSON."""

from __future__ import annotations

import html
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from ...errors import AtcError
from ...running.output import explained, plain
from ...running.whole import write_dataset

YES, ASSUMING, NO = "reproduces", "reproduces with an assumption", "does not reproduce"

STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "axes.linewidth": 0.8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "savefig.dpi": 130,
    "lines.linewidth": 1.2,
    "mathtext.default": "regular",
    "image.interpolation": "nearest",
}

_CSS = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem } h2 { font-size: 1.2rem; margin-top: 2.2rem }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.9rem }
th, td { padding: 0.25rem 0.7rem; text-align: left; vertical-align: top; border-bottom: 1px solid #ddd }
th { border-bottom: 2px solid #888 } td.num { text-align: right; font-variant-numeric: tabular-nums }
figure { margin: 1.2rem 0 } figure img { max-width: 100% } figcaption { color: #555; font-size: 0.9rem }
.yes { color: #176d2c } .assuming { color: #8a6100 } .no { color: #a3201c }
"""
_CLASS = {YES: "yes", ASSUMING: "assuming", NO: "no"}


@dataclass(frozen=True)
class Claim:
    """One claim of a paper. `where`: equation, table or figure; `claim` and `measured`: one sentence each;
    `assumption`: what had to be assumed, or why not."""

    where: str
    claim: str
    measured: str
    verdict: str
    assumption: str = ""


@dataclass
class Report:
    """Collects sections, claims, pictures and numbers; `write` makes report.html and numbers.json of them."""

    title: str
    folder: Path
    claims: list[Claim] = field(default_factory=list)
    numbers: dict = field(default_factory=dict)
    _body: list[str] = field(default_factory=list)

    def __post_init__(self):
        self.folder = Path(self.folder)
        if self.folder.exists() and not self.folder.is_dir():
            raise AtcError(f"{self.folder}: is a file; give a directory for the report")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as e:
            raise AtcError(f"{self.folder}: cannot be made ({e.strerror}): choose another directory") from None

    def heading(self, text: str) -> None:
        self._body.append(f"<h2>{html.escape(text)}</h2>")

    def text(self, text: str) -> None:
        self._body.append(f"<p>{html.escape(text)}</p>")

    def table(self, head: str, rows: list[list], caption: str = "") -> None:
        """Rows under heads, which ` | ` separates."""
        cells = "".join(
            "<tr>" + "".join(f"<td{_num(c)}>{html.escape(_show(c))}</td>" for c in row) + "</tr>" for row in rows
        )
        title = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
        self._body.append(
            f"<figure><table><tr>{''.join(f'<th>{html.escape(h)}</th>' for h in head.split(' | '))}</tr>{cells}</table>"
            f"{title}</figure>"
        )

    def claim(self, where: str, claim: str, measured: str, verdict: str, assumption: str = "") -> None:
        self.claims.append(Claim(where, claim, measured, verdict, assumption))

    def figure(self, name: str, caption: str, draw, size=(8.0, 4.0)) -> None:
        """Draw into a new matplotlib figure with `draw(figure)` and save it as name.png."""
        import matplotlib
        from matplotlib.figure import Figure

        with matplotlib.rc_context(STYLE):
            fig = Figure(figsize=size, layout="constrained")
            draw(fig)
            fig.savefig(self.folder / f"{name}.png", metadata={"Software": None})
        self._body.append(
            f'<figure><img src="{name}.png" '
            f'alt="{html.escape(caption)}"><figcaption>{html.escape(caption)}</figcaption></figure>'
        )

    def dataset(self, name: str, ds) -> None:
        """Save a dataset as name.nc beside the report."""
        write_dataset(ds, self.folder / f"{name}.nc")

    def write(self) -> Path:
        rows = "".join(
            f"<tr><td>{html.escape(c.where)}</td><td>{html.escape(c.claim)}</td><td>{html.escape(c.measured)}</td>"
            f'<td><b class="{_CLASS[c.verdict]}">{c.verdict}</b>{": " if c.assumption else ""}'
            f"{html.escape(c.assumption)}</td></tr>"
            for c in self.claims
        )
        page = (
            '<!DOCTYPE html>\n<html lang="en"><head><meta '
            f'charset="utf-8"><title>{html.escape(self.title)}</title><style>{_CSS}</style></head>\n'
            f"<body><h1>{html.escape(self.title)}</h1>\n<h2>Claim by "
            "claim</h2><table><tr><th>where</th><th>claim</th><th>measured</th><th>verdict</th></tr>"
            f"{rows}</table>\n" + "\n".join(self._body) + "\n</body></html>\n"
        )

        path = self.folder / "report.html"
        with explained(path):
            path.write_text(page, encoding="utf-8")
            numbers = {"title": self.title, "claims": [asdict(c) for c in self.claims], **self.numbers}
            (self.folder / "numbers.json").write_text(
                json.dumps(numbers, indent=1, default=plain) + "\n", encoding="utf-8"
            )
        return path


def _num(c) -> str:
    return ' class="num"' if isinstance(c, (int, float)) and not isinstance(c, bool) else ""


def _show(c) -> str:
    if isinstance(c, bool):
        return "yes" if c else "no"
    if isinstance(c, float):
        return f"{c:.5g}"
    return str(c)


def percent(value: float) -> str:
    """A fraction in per cent."""
    return f"{100 * value:.3g} %"


def draw_density(ax, x, t, density, title: str, *, limits=None, zoom=None):
    """The paper's picture: reference position across, time downwards, density as colour. `zoom` = (x0, x1, t0, t1)."""
    x, t, density = np.asarray(x), np.asarray(t), np.asarray(density)
    if zoom is not None:
        cols, rows = (x >= zoom[0]) & (x <= zoom[1]), (t >= zoom[2]) & (t <= zoom[3])
        x, t, density = x[cols], t[rows], density[np.ix_(rows, cols)]
    step = max(1, len(x) // 2000)
    x, density = x[::step], density[:, ::step]
    lo, hi = limits if limits is not None else (density.min(), density.max())
    image = ax.pcolormesh(x, t, density, cmap="viridis", vmin=lo, vmax=hi, shading="nearest", rasterized=True)
    ax.set(title=title, xlabel="reference position", ylabel="time", ylim=(t[-1], t[0]))
    return image
