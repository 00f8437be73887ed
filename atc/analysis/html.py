"""What pages are made of: HTML that holds everything it shows. All text is escaped."""

from __future__ import annotations

import base64
import io
from html import escape

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; color: #1c1c1c; background: #fff;
       max-width: 62rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem;
     border-bottom: 1px solid #ccc; padding-bottom: .2rem; }
.sub { color: #555; margin: 0 0 1rem; }
table { border-collapse: collapse; margin: .4rem 0 1rem; font-size: .9rem; }
th, td { padding: .18rem .7rem .18rem 0; text-align: left; vertical-align: top; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; } td.n { white-space: nowrap; }
thead th { border-bottom: 1px solid #999; font-weight: 600; } tbody tr:nth-child(even) { background: #f6f6f6; }
table.facts th { font-weight: 600; color: #444; white-space: nowrap; } table.facts tbody tr { background: none; }
figure { margin: 1rem 0 1.6rem; } figure img { max-width: 100%; height: auto; }
figure.half { display: inline-block; width: 48%; margin-right: 1%; vertical-align: top; }
figcaption { color: #555; font-size: .85rem; }
ul.warn { background: #fff6e0; border-left: 4px solid #d99a00; padding: .6rem 1rem .6rem 2rem; }
pre { background: #f6f6f6; padding: .8rem 1rem; overflow-x: auto; font-size: .82rem; white-space: pre-wrap;
      overflow-wrap: anywhere; }
caption { text-align: left; font-weight: 600; padding: .6rem 0 .2rem; }
@media print { body { max-width: none; margin: 0; font-size: 11pt; } h2 { break-after: avoid; }
  figure, table, tr { break-inside: avoid; } pre { overflow: visible; } }
"""


def document(title: str, body) -> str:
    """The whole page, of its parts."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def table(rows, head=(), caption="", numbers=(), kind="") -> str:
    """Rows of cells as HTML; `numbers`: which columns are numbers."""

    def cells(row, tag):
        return "".join(f'<{tag}{" class=" + chr(34) + "n" + chr(34) if k in numbers else ""}>{escape(str(c))}</{tag}>'
                       for k, c in enumerate(row))  # fmt: skip

    out = [f'<table class="{kind}">' if kind else "<table>"]
    if caption:
        out.append(f"<caption>{escape(caption)}</caption>")
    if head:
        out.append(f"<thead><tr>{cells(head, 'th')}</tr></thead>")
    out.append("<tbody>" + "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows) + "</tbody></table>")
    return "".join(out)


def facts(rows) -> str:
    """What is what, as a table of two columns."""
    head = "".join(f"<tr><th>{escape(str(k))}</th><td>{escape(str(v))}</td></tr>" for k, v in rows)
    return f'<table class="facts"><tbody>{head}</tbody></table>'


def warned_of(said) -> list[str]:
    """The part with warnings; nothing where there are none."""
    if not said:
        return []
    items = "".join(f"<li>{escape(s)}</li>" for s in said)
    return ["<h2>Warnings and notes</h2>", f'<ul class="warn">{items}</ul>']


def scene_of(ds) -> list[str]:
    """The part with the scene that a dataset was made from, if it says so."""
    scene = str(ds.attrs.get("scene", "")).strip()
    return ["<h2>The scene</h2>", f"<pre>{escape(scene)}</pre>"] if scene else []


def figure_of(fig, words: str) -> str:
    """A figure with its caption, as an image within the page."""
    import matplotlib as mpl

    from ..pictures.drawing import STYLE, fitted

    with mpl.rc_context(STYLE):
        held = io.BytesIO()
        fitted(fig).savefig(held, format="png", dpi=110, metadata={"Software": None})
    data = base64.b64encode(held.getvalue()).decode()
    half = ' class="half"' if fig.get_size_inches()[0] < 5.5 else ""
    return (
        f'<figure{half}><img alt="{escape(words, quote=True)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escape(words)}</figcaption></figure>"
    )
