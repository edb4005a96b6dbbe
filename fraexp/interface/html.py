"""Objects in a notebook's cell: a heading, a figure and a table as HTML."""

import base64
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TEMPLATE = """<div>
<p><strong>{{ heading }}</strong>{% for note in notes %}<br>{{ note }}{% endfor %}</p>
{% if figure %}<img alt="{{ heading }}" style="max-width: 100%" src="data:image/png;base64,{{ figure }}">{% endif %}
{% if rows %}<table><thead><tr>{% for column in columns %}<th>{{ column }}</th>{% endfor %}</tr></thead>
<tbody>{% for row in rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</tbody></table>
{% endif %}{% if text %}<pre>{{ text }}</pre>{% endif %}
</div>"""


def page_part(
    heading: str,
    notes: Sequence[str] = (),
    figure: "Figure | None" = None,
    columns: Sequence[str] = (),
    rows: Sequence[Sequence[str]] = (),
    text: str = "",
) -> str:
    """Return HTML with a heading, a figure and a table, of which all texts are escaped."""
    from jinja2 import Environment

    from fraexp.figures.elements.canvas import png_bytes

    picture = base64.b64encode(png_bytes(figure)).decode() if figure is not None else ""
    template = Environment(autoescape=True).from_string(TEMPLATE)
    return template.render(heading=heading, notes=notes, figure=picture, columns=columns, rows=rows, text=text)
