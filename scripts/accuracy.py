#!/usr/bin/env python3
"""Makes the table and the picture of speed against accuracy from what bench/ecol_accuracy printed.

accuracy.py           writes docs/performance/accuracy.md and docs/images/accuracy.svg
accuracy.py --check   writes nothing; exits with 1 where they are not what the figures say

The figures are docs/performance/accuracy.csv; the GPU's times, where there are some, docs/performance/accuracy_gpu.csv
(columns model, method, index_bits, ms_gpu). Options name other files.
Nothing but Python's standard library is needed.
"""

import argparse
import csv
import math
import pathlib
import sys

DOCS = pathlib.Path(__file__).resolve().parent.parent / "docs"
SHARES = ("50", "10", "1")


def number(text):
    return float(text) if text else None


def read(path, gpu_path):
    rows = []
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            known = {"model": row["model"], "method": row["method"], "bits": int(row["index_bits"])}
            rows.append(known | {k: number(v) for k, v in row.items() if k not in ("model", "method", "index_bits")})
    if gpu_path.exists():
        with gpu_path.open(encoding="utf-8", newline="") as file:
            times = {(r["model"], r["method"], int(r["index_bits"])): number(r["ms_gpu"]) for r in csv.DictReader(file)}
        for row in rows:
            row["ms_gpu"] = times.get((row["model"], row["method"], row["bits"]), row["ms_gpu"])
    return rows


def figure(value, digits=3):
    """A number with so many significant digits, no exponent."""
    if value is None:
        return ""
    if value == 0:
        return "0"
    return f"{value:,.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}"


# ---- the table ------------------------------------------------------------------------------------------------------


def table(rows):
    text = [
        "<!-- made by scripts/accuracy.py from accuracy.csv -->",
        "",
        "Errors are root mean square distances to the full model in 1/10000 of its diagonal, in brackets the ratio",
        "to `meshopt_simplify` at the same triangle count. Times are milliseconds, the least of five: of `build_ecol`",
        "for all levels (meshoptimizer: for these three), of `rearrange`, and of `reform` at half the vertices; KiB",
        "are those of triangles and targets. Boundaries slide unless the method says locked; *all cores* is filled",
        "for rounds only, since the greedy order of one mesh runs on one. 16 bits give the very same levels.",
        "",
        "| model | method | index | 50 % | 10 % | 1 % | one core | all cores | GPU | rearrange | reform | KiB |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    last = None
    for row in rows:
        cells = []
        for share in SHARES:
            rms, ratio = row["rms_" + share], row["ratio_" + share]
            if rms is None:
                cells.append("not reached")
            elif row["method"] == "meshopt_simplify":
                cells.append(figure(rms))
            else:
                cells.append(f"{figure(rms)} ({ratio:.2f})")
        name = f"{row['model']}, {row['triangles']:,.0f}" if row["model"] != last else ""
        last = row["model"]
        cells = [name, row["method"].replace("_", "\\_"), f"{row['bits']}", *cells]
        cells += [figure(row[c]) for c in ("ms_one_core", "ms_all_cores", "ms_gpu", "rearrange_ms", "reform_half_ms")]
        cells.append("" if row["bytes"] is None else f"{row['bytes'] / 1024:,.0f}")
        text.append("| " + " | ".join(cells) + " |")
    return "\n".join(text) + "\n"


# ---- the picture ----------------------------------------------------------------------------------------------------

WAYS = {  # method: colour, shape, label
    "quadric": ("#1f5fa8", "circle", "quadric, greedy"),
    "quadric, rounds": ("#1f5fa8", "square", "quadric, rounds"),
    "melax": ("#c8571b", "circle", "Melax, greedy"),
    "melax, rounds": ("#c8571b", "square", "Melax, rounds"),
}
WIDTH, HEIGHT = 1200, 520
TOP, BOTTOM, LEFT, GAP = 96, 120, 84, 22
PANEL = (WIDTH - LEFT - 24 - 2 * GAP) / 3


def geometric_mean(values):
    return math.exp(sum(map(math.log, values)) / len(values))


def mark(shape, x, y, r, colour, filled, rim=None, opacity=1.0):
    style = f'fill="{colour if filled else "#ffffff"}" stroke="{rim or colour}" stroke-width="{1 if r < 5 else 2}"'
    if opacity < 1:
        style += f' opacity="{opacity}"'
    if shape == "circle":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r}" {style}/>'
    return f'<rect x="{x - r:.1f}" y="{y - r:.1f}" width="{2 * r}" height="{2 * r}" {style}/>'


def write(x, y, words, size=15, anchor="start", colour="#222", weight="normal", turn=""):
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" fill="{colour}" '
        f'font-weight="{weight}"{turn}>{words}</text>'
    )


def line(x1, y1, x2, y2, colour, width=1):
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" stroke-width="{width}"/>'
    )


def points(rows, share):
    """Of every model that got there: method, bits, where, million triangles a second, error in those of quadric greedy,
    and whether 16 bits can index the model. 16 bits come first, to be drawn below."""
    found = []
    narrow = {r["model"] for r in rows if r["bits"] == 16}
    base = {r["model"]: r["rms_" + share] for r in rows if r["method"] == "quadric" and r["bits"] == 32}
    for row in rows:
        rms, against = row["rms_" + share], base.get(row["model"])
        if row["method"] not in WAYS or rms is None or not against:
            continue
        for where in ("ms_one_core", "ms_gpu"):
            if row[where]:
                speed = row["triangles"] / row[where] / 1e3
                found.append((row["method"], row["bits"], where, speed, rms / against, row["model"] in narrow))
    return sorted(found, key=lambda point: point[1])


def picture(rows):
    data = {share: points(rows, share) for share in SHARES}
    everything = [p for panel in data.values() for p in panel]
    ticks_x = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
    low_x = max(t for t in ticks_x if t <= min(p[3] for p in everything))
    high_x = min(t for t in ticks_x if t >= max(p[3] for p in everything))
    ticks_x = [t for t in ticks_x if low_x <= t <= high_x]
    ticks_y = (0.5, 0.7, 1, 1.4, 2, 2.8, 4)
    low_y = max([t for t in ticks_y if t <= min(p[4] for p in everything)] or [ticks_y[0]])
    high_y = min([t for t in ticks_y if t >= max(p[4] for p in everything)] or [ticks_y[-1]])
    ticks_y = [t for t in ticks_y if low_y <= t <= high_y]

    def at_y(value):
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * math.log(value / low_y) / math.log(high_y / low_y)

    svg = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        'font-family="Helvetica, Arial, sans-serif">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
        write(LEFT, 32, "Speed against accuracy of build_ecol: every level of one mesh, on one core", 20,
              weight="bold"),
        write(LEFT, 56, "Small: one model each. Large: geometric mean of those that 16 bits can index. "
              "Hollow: with 16-bit indices, the same collapses."),
        write(22, (TOP + HEIGHT - BOTTOM) / 2, "surface error, quadric greedy = 1", 15, "middle",
              turn=f' transform="rotate(-90 22 {(TOP + HEIGHT - BOTTOM) / 2:.1f})"'),
        write(LEFT + (WIDTH - LEFT - 24) / 2, HEIGHT - BOTTOM + 50,
              "million triangles a second (further right is faster)", 15, "middle"),
    ]
    for i, share in enumerate(SHARES):
        left = LEFT + i * (PANEL + GAP)

        def at_x(value, left=left):
            return left + PANEL * math.log(value / low_x) / math.log(high_x / low_x)

        svg.append(f'<rect x="{left:.1f}" y="{TOP}" width="{PANEL:.1f}" height="{HEIGHT - TOP - BOTTOM}" '
                   'fill="#fafafa" stroke="#999"/>')
        svg.append(write(left + PANEL / 2, TOP - 10, f"{share} % of the triangles", 16, "middle", weight="bold"))
        for tick in ticks_x:
            if low_x < tick < high_x:
                svg.append(line(at_x(tick), TOP, at_x(tick), HEIGHT - BOTTOM, "#ddd"))
            anchor = "start" if tick == low_x else "end" if tick == high_x else "middle"
            svg.append(write(at_x(tick), HEIGHT - BOTTOM + 20, f"{tick:g}", 14, anchor))
        for tick in ticks_y:
            colour, wide = ("#888", 1.5) if tick == 1 else ("#ddd", 1)
            svg.append(line(left, at_y(tick), left + PANEL, at_y(tick), colour, wide))
            if i == 0:
                svg.append(write(left - 8, at_y(tick) + 5, f"{tick:g}", 14, "end"))
        groups = {}
        for method, bits, where, speed, error, in_mean in data[share]:
            colour, shape, _ = WAYS[method]
            rim = "#000000" if where == "ms_gpu" else None
            svg.append(mark(shape, at_x(speed), at_y(error), 3.5, colour, bits == 32, rim, 0.45))
            if in_mean:
                groups.setdefault((method, bits, where), []).append((speed, error))
        for (method, bits, where), values in groups.items():
            colour, shape, _ = WAYS[method]
            rim = "#000000" if where == "ms_gpu" else None
            x, y = geometric_mean([v[0] for v in values]), geometric_mean([v[1] for v in values])
            if bits == 32:
                svg.append(mark(shape, at_x(x), at_y(y), 8, colour, True, rim))
            else:
                svg.append(mark(shape, at_x(x), at_y(y), 11, colour, False, rim))
    x = LEFT
    for colour, shape, label in WAYS.values():
        svg.append(mark(shape, x + 8, HEIGHT - 34, 7, colour, True))
        svg.append(write(x + 24, HEIGHT - 29, label, 15))
        x += 170
    if any(p[2] == "ms_gpu" for p in everything):
        svg.append(mark("circle", x + 8, HEIGHT - 34, 7, "#ffffff", True, "#000000"))
        svg.append(write(x + 24, HEIGHT - 29, "black rim: on the GPU", 15))
    svg.append("</svg>")
    return "\n".join(svg) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="only tell whether both are up to date")
    parser.add_argument("--csv", type=pathlib.Path, default=DOCS / "performance" / "accuracy.csv")
    parser.add_argument("--gpu", type=pathlib.Path, default=DOCS / "performance" / "accuracy_gpu.csv")
    parser.add_argument("--table", type=pathlib.Path, default=DOCS / "performance" / "accuracy.md")
    parser.add_argument("--picture", type=pathlib.Path, default=DOCS / "images" / "accuracy.svg")
    options = parser.parse_args()

    rows = read(options.csv, options.gpu)
    stale = False
    for path, made in ((options.table, table(rows)), (options.picture, picture(rows))):
        if not options.check:
            path.write_text(made, "utf-8")
        elif not path.exists() or path.read_text("utf-8") != made:
            print(f"{path} is not what {options.csv} says: run scripts/accuracy.py", file=sys.stderr)
            stale = True
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
