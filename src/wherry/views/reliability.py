"""A reliability diagram: how often what was called so probable was so, as an SVG picture."""

from __future__ import annotations

from wherry.space.pose import Floats

SIDE = 360  # px, of the diagram
MARGIN = 56  # px, around it
TICKS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
SMALLEST, LARGEST = 3.0, 9.0  # px, radii of the points, which grow with the share of the scans


def reliability_diagram(reliability: Floats, said: str, was: str) -> str:
    """Draw a reliability table.

    Args:
        reliability: [B, 3] stated probability, share of the cases that came true, number of cases; a row of NaN is left
            out.
        said: What was stated, for the horizontal axis.
        was: What came true, for the vertical axis.

    Returns:
        SVG; the diagonal is perfect calibration.
    """
    size = SIDE + 2 * MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size} {size}" font-family="sans-serif" font-size="12">',
        f'<rect width="{size}" height="{size}" fill="white"/>',
        _line(0.0, 0.0, 1.0, 1.0, "#999999", dashed=True),
        _line(0.0, 0.0, 1.0, 0.0, "black"),
        _line(0.0, 0.0, 0.0, 1.0, "black"),
        *(_text(_x(tick), size - MARGIN + 18, f"{tick:.1f}") for tick in TICKS),
        *(_text(MARGIN - 18, _y(tick) + 4, f"{tick:.1f}") for tick in TICKS),
        _text(size / 2, size - 14, said),
        f'<g transform="rotate(-90)">{_text(-size / 2, 16, was)}</g>',
    ]
    kept = [row for row in reliability.tolist() if row[2] > 0]
    most = max((row[2] for row in kept), default=1.0)
    points = [(_x(stated), _y(true), count) for stated, true, count in kept]
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y, _ in points)
    parts.append(f'<polyline points="{way}" fill="none" stroke="#1f6fb4"/>')
    for x, y, count in points:
        radius = SMALLEST + (LARGEST - SMALLEST) * (count / most) ** 0.5
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="#1f6fb4"><title>{count:.0f}</title></circle>'
        )
    return "\n".join([*parts, "</svg>\n"])


def _x(value: float) -> float:
    return MARGIN + SIDE * value


def _y(value: float) -> float:
    return MARGIN + SIDE * (1.0 - value)


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, *, dashed: bool = False) -> str:
    dashes = ' stroke-dasharray="4 4"' if dashed else ""
    ends = f'x1="{_x(x1):.1f}" y1="{_y(y1):.1f}" x2="{_x(x2):.1f}" y2="{_y(y2):.1f}"'
    return f'<line {ends} stroke="{colour}"{dashes}/>'


def _text(x: float, y: float, words: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{words}</text>'
