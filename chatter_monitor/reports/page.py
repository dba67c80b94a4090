"""A page with everything inside: style, pictures, and texts that nobody can smuggle markup into."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

from chatter_monitor.outlets.look import Colour

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = """
:root{--line:#d8d8d8;--soft:#666;--ground:#f5f4f1}
*{box-sizing:border-box}
body{font:16px/1.5 system-ui,"DejaVu Sans",sans-serif;color:#1d1d1d;background:#fff;max-width:64rem;margin:0 auto;
padding:1.5rem 1rem 3rem}
h1{font-size:1.6rem;line-height:1.2;margin:0 0 .3rem}h2{font-size:1.15rem;margin:2rem 0 .5rem}
p{margin:.4rem 0}.soft{color:var(--soft)}
.answer{border-left:.45rem solid var(--accent,#888);background:var(--ground);padding:.8rem 1rem;margin:1rem 0;
font-size:1.1rem}
.numbers{display:grid;grid-template-columns:repeat(auto-fit,minmax(8rem,1fr));gap:.6rem;margin:1rem 0}
.numbers div{border:1px solid var(--line);border-radius:.4rem;padding:.5rem .7rem}
.numbers b{display:block;font-size:1.35rem;line-height:1.25}.numbers span{color:var(--soft);font-size:.85rem}
figure{margin:1rem 0}figure img{width:100%;height:auto;display:block}
figcaption{color:var(--soft);font-size:.9rem}
.wide{overflow-x:auto}table{border-collapse:collapse;width:100%;font-size:.95rem}
th,td{text-align:left;padding:.35rem .7rem .35rem 0;border-bottom:1px solid var(--line);vertical-align:top}
@media(max-width:30rem){body{padding:1rem .8rem 2rem}h1{font-size:1.3rem}
table.stack thead{display:none}table.stack tr{display:block;border-bottom:1px solid var(--line);padding:.4rem 0}
table.stack td{display:flex;justify-content:space-between;gap:1rem;border:0;padding:.1rem 0;text-align:right}
table.stack td span{overflow-wrap:anywhere}
table.stack td::before{content:attr(data-of);color:var(--soft);text-align:left}}
@media print{body{max-width:none;padding:0;font-size:11pt}figure,tr,.answer,.numbers div{break-inside:avoid}
figure img{width:auto;max-width:100%;max-height:15cm}
.answer{-webkit-print-color-adjust:exact;print-color-adjust:exact}h2{break-after:avoid}}
"""


def page(title: str, parts: Iterable[str]) -> str:
    """HTML page; the parts are HTML, the title is text."""
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<title>{text(title)}</title><style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def text(value: object) -> str:
    """Text as HTML."""
    return html.escape(str(value))


def answer(word: str, sentence: str, colour: Colour) -> str:
    """The one thing to know, in the colour of its state."""
    return f'<div class="answer" style="--accent:{hex_colour(colour)}"><b>{text(word)}</b> {text(sentence)}</div>'


def numbers(named: Sequence[tuple[str, str]]) -> str:
    """Numbers that stand out, each with what it is."""
    cells = "".join(f"<div><b>{text(value)}</b><span>{text(name)}</span></div>" for name, value in named)
    return f'<div class="numbers">{cells}</div>'


class Link(NamedTuple):
    """Text that leads to a file, by its path from the page."""

    text: str
    path: str


def table(headings: Sequence[str], rows: Iterable[Sequence[str | Link]]) -> str:
    """Table; on a phone a row becomes a list."""
    head = "".join(f"<th>{text(heading)}</th>" for heading in headings)
    body = "".join(
        "<tr>"
        + "".join(
            f'<td data-of="{text(heading)}"><span>{_cell(cell)}</span></td>'
            for heading, cell in zip(headings, row, strict=True)
        )
        + "</tr>\n"
        for row in rows
    )
    return f'<div class="wide"><table class="stack"><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>'


def _cell(cell: str | Link) -> str:
    if isinstance(cell, Link):
        return f'<a href="{quote(cell.path)}">{text(cell.text)}</a>'
    return text(cell)


def facts(named: Iterable[tuple[str, str]]) -> str:
    """What is known, line by line."""
    rows = "".join(f'<tr><td class="soft">{text(name)}</td><td>{text(value)}</td></tr>\n' for name, value in named)
    return f'<div class="wide"><table><tbody>\n{rows}</tbody></table></div>'


def picture(figure: Figure, description: str) -> str:
    """Figure inside the page, with what is to be seen on it for those who cannot see it."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    drawn = _embedded(buffer, "svg+xml", description)
    return f"<figure>{drawn}<figcaption>{text(description)}</figcaption></figure>"


def bitmap(figure: Figure, description: str, dpi: int) -> str:
    """Figure with too many points for a drawing, inside the page, without a caption."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return f"<figure>{_embedded(buffer, 'png', description)}</figure>"


def _embedded(file: io.BytesIO, kind: str, description: str) -> str:
    data = base64.b64encode(file.getvalue()).decode()
    return f'<img alt="{text(description)}" src="data:image/{kind};base64,{data}">'


def hex_colour(colour: Colour) -> str:
    """Colour as matplotlib and browsers write it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
