#!/usr/bin/env python3
"""Makes the tables and pictures of occlusion culling from what bench/occlusion_study printed.

occlusion.py           writes docs/performance/occlusion.md, docs/images/occlusion.svg and occlusion_trade.svg
occlusion.py --check   writes nothing; exits with 1 where they are not what the figures say

The figures are docs/performance/occlusion.csv: the output of occlusion_study for some scenes, then that of
occlusion_study --trade --no-header. Options name other files. Nothing but Python's standard library is needed.
"""

import argparse
import csv
import math
import pathlib
import sys

sys.dont_write_bytecode = True  # of the script beside this one

from accuracy import figure, line, mark, write  # noqa: E402

DOCS = pathlib.Path(__file__).resolve().parent.parent / "docs"
TEXTS = ("table", "scene", "place", "choice")
SELECTED = (20, 100, 500, 2000)  # numbers of occluders in the tables
BUYS = 500  # that of the table of what culling buys


def read(path):
    """The rows by table; numbers are floats, None where the field is empty."""
    tables = {"effect": [], "trade": []}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            numbers = {k: float(v) if v else None for k, v in row.items() if k not in TEXTS}
            tables[row["table"]].append({k: row[k] for k in TEXTS} | numbers)
    return tables


def groups(rows):
    """The rows of each scene and place, in their order."""
    found = {}
    for row in rows:
        found.setdefault((row["scene"], row["objects"], row["place"]), []).append(row)
    return found


def scene_name(scene, objects):
    return f"{scene.replace('_', ' ')}, {objects:,.0f}"


def pick(rows, choice, occluders=None):
    return next((r for r in rows if r["choice"] == choice and occluders in (None, r["occluders"])), None)


def found(row):
    """The share of the objects hidden behind others that was culled, in percent."""
    return 100 * row["culled_hidden"] / row["hidden"] if row["hidden"] else None


def ratio(row):
    """All culled objects to all that show no sample, in percent."""
    invisible = row["hidden"] + row["no_sample"]
    return 100 * row["culled"] / invisible if invisible else None


def percent(value):
    return "" if value is None else f"{value:.1f}"


def milliseconds(row):
    return sum(row[k] for k in ("ms_select", "ms_depth", "ms_hzm", "ms_test")) / row["cameras"]


# ---- the tables -----------------------------------------------------------------------------------------------------


def heading(cells):
    return ["| " + " | ".join(cells) + " |", "|" + "---|" * len(cells)]


def lines_of(by_scene, cells_of):
    text, last = [], None
    for (scene, objects, place), rows in by_scene.items():
        cells = cells_of(rows)
        name = scene_name(scene, objects) if (scene, objects) != last else ""
        if cells:
            cameras = f"{rows[0]['cameras']:.0f} {place}"
            text.append("| " + " | ".join([name, cameras, *cells]) + " |")
            last = (scene, objects)
    return text


def total(by_scene, choice, occluders, measure):
    """The measure of the sums over all scenes and places."""
    picked = [pick(rows, choice, occluders) for rows in by_scene.values()]
    picked = [row for row in picked if row]
    return measure({k: sum(r[k] for r in picked) for k in ("culled", "culled_hidden", "hidden", "no_sample")})


def effect_table(by_scene):
    def cells_of(rows):
        first = rows[0]
        cells = [f"{first[k]:,.0f}" for k in ("in_view", "seen", "hidden", "no_sample")]
        for k in SELECTED:
            row = pick(rows, "selected", k)
            cells += [f"{row['culled']:,.0f}", percent(found(row)), percent(ratio(row))] if k == 20 else [
                percent(found(row)), percent(ratio(row))]
        return cells

    names = ["scene, objects", "cameras", "in view", "seen", "hidden", "no sample", "culled by 20"]
    for k in SELECTED:
        names += [f"{k:,}: found %", "ratio %"]
    sums = [f"{sum(rows[0][k] for rows in by_scene.values()):,.0f}" for k in ("in_view", "seen", "hidden", "no_sample")]
    culled = sum(pick(rows, "selected", 20)["culled"] for rows in by_scene.values())
    sums.append(f"{culled:,.0f}")
    for k in SELECTED:
        sums += [percent(total(by_scene, "selected", k, found)), percent(total(by_scene, "selected", k, ratio))]
    return [*heading(names), *lines_of(by_scene, cells_of), "| all | | " + " | ".join(sums) + " |"]


LIMITS = (
    ("selected", 500, "selected, 500"),
    ("temporal", 500, "temporal, 500"),
    ("selected", 2000, "selected, 2,000"),
    ("temporal", 2000, "temporal, 2,000"),
    ("most seen", 500, "most seen, 500"),
    ("all of last", None, "all of last"),
    ("all", None, "all in view"),
    ("every texel", None, "every texel"),
    ("every sample", None, "every sample"),
)


def limits_table(by_scene):
    def cells_of(rows):
        chosen = pick(rows, "selected", 500)
        own = 100 * chosen["culled_occluders"] / chosen["hidden"] if chosen["hidden"] else None
        return [percent(own), *(percent(found(pick(rows, choice, k))) for choice, k, _ in LIMITS)]

    names = ["scene, objects", "cameras", "occluders", *(label for _, _, label in LIMITS)]
    sums = ["", *(percent(total(by_scene, choice, k, found)) for choice, k, _ in LIMITS)]
    return [*heading(names), *lines_of(by_scene, cells_of), "| all | | " + " | ".join(sums) + " |"]


AIM = 80  # percent of the hidden objects


def aim_text(by_scene):
    """How often the aim is reached, by the choices of the table of limits."""
    reached = []
    for choice, k, label in LIMITS:
        shares = [found(pick(rows, choice, k)) for rows in by_scene.values()]
        reached.append(f"{label}: {sum(share is not None and share >= AIM for share in shares)}")
    lead = f"Of these {len(by_scene)} scenes and places, at least {AIM} % are found in so many:"
    return [lead, "; ".join(reached) + "."]


def buys_table(by_scene):
    def change(row, key):
        off, on = row[f"{key}_off"], row[f"{key}_on"]
        return f"{off:,.0f} → {on:,.0f} ({100 * (on / off - 1):+.0f} %)" if off else ""

    def cells_of(rows):
        row = pick(rows, "selected", BUYS)
        released = 100 * row["vertices_culled"] / row["vertices_in_view"] if row["vertices_in_view"] else 0
        cells = [f"{row['vertices_culled']:,.0f} ({released:.0f} %)", f"{row['budget']:,.0f}"]
        return cells + [change(row, key) for key in ("seen_vertices", "seen_triangles", "seen_drawn")]

    names = ["scene, objects", "cameras", "vertices released", "budget", "vertices of seen objects", "their triangles",
             "seen objects drawn"]
    return [*heading(names), *lines_of(by_scene, cells_of)]


def trade_tables(rows):
    text = []
    for (scene, objects, place), group in groups(rows).items():
        scales = sorted({r["scale"] for r in group})
        thresholds = sorted({r["threshold"] for r in group if r["scale"] == 1})
        text += ["", f"{scene_name(scene, objects)} objects, {place}:", ""]
        text += heading(["occluders", *(f"map 1/{s:.0f}" for s in scales if s > 1),
                         *(f"map 1/1, at least {t:g}" for t in thresholds)])
        for k in sorted({r["occluders"] for r in group}):
            cells = [f"{k:,.0f}"]
            wanted = [(s, 0.5) for s in scales if s > 1] + [(1, t) for t in thresholds]
            for scale, threshold in wanted:
                row = next(r for r in group
                           if (r["occluders"], r["scale"], r["threshold"]) == (k, scale, threshold))
                cells.append(f"{percent(found(row))} %, {figure(milliseconds(row))} ms")
            text.append("| " + " | ".join(cells) + " |")
        steps = [r for r in group if (r["scale"], r["threshold"]) == (1, 0.5)]
        text += ["", "Of that, map 1/1 and at least 0.5, in milliseconds:", ""]
        text += heading(["occluders", "their triangles", "select", "depth", "map", "test"])
        for row in steps:
            cells = [f"{row['occluders']:,.0f}", f"{row['occluder_triangles'] / row['cameras']:,.0f}"]
            cells += [figure(row[k] / row["cameras"]) for k in ("ms_select", "ms_depth", "ms_hzm", "ms_test")]
            text.append("| " + " | ".join(cells) + " |")
    return text


# ---- the page -------------------------------------------------------------------------------------------------------

INTRODUCTION = """
# What occlusion culling finds

A scene is seen from cameras around it, with all of it in the picture, and from as many on a way through it, low, the
gaze turning left and right; 1920 x 1080, one sample a pixel. All counts are sums over the cameras. The truth is a
picture of which object is nearest at each sample, of the full triangles of all objects in view, drawn by the study's
own rasteriser. An object is *seen* if it is the nearest at a sample, *hidden* if it covers samples but is nearest at
none, and has *no sample* if its triangles fall between the samples or beside the picture. Of {culled:,.0f} objects
culled in all these frames, {wrong:,.0f} were seen.

    occlusion_study SCENE... > docs/performance/occlusion.csv
    OMP_NUM_THREADS=1 occlusion_study --trade --no-header SCENE... >> docs/performance/occlusion.csv
    scripts/occlusion.py

## Effectiveness

*Found* is the share of the hidden objects that was culled, *ratio* all culled objects to all that show nothing, hidden
or without a sample ([Peng13] Table 4.4: 58.3 %). The number before it is that of the occluders, which
`select_occluders` chooses among the objects with compactness at least 0.5; the map has the picture's size.
"""

LIMITS_TEXT = """
## What limits it

Found, in percent of the hidden objects, by other choices:

- *occluders*: of what 500 selected ones find, those that are occluders themselves. They need not stay, since none
  hides itself: its depths are never nearer than its box;
- *temporal*: half of the occluders are chosen among what the last frame showed, 1/600 of the way before, the other half
  among what the first do not hide: `--occlusion temporal` of the viewer with half the number;
- *most seen*: the 500 objects that show the most samples, which only the truth knows;
- *all of last*: all that the last frame showed, with 4,000 temporal ones;
- *all in view*: all objects are occluders, and tested: the most that the test can find;
- *every texel*: the same, and the test reads every texel that the rectangle of the box, grown by a pixel, touches,
  instead of the 2 x 2 that hold them;
- *every sample*: only those whose centre is in the rectangle, and a rectangle with none shows nothing: what
  axis-aligned boxes can find at most.
"""

BUYS_TEXT = """
## What it buys

With {occluders} occluders selected: the vertices of the culled objects at full detail, and what `distribute_budget`
(fair) gives to the objects that are seen, without and with culling. The budget is a tenth of the vertices in view, at
most a million a picture.
"""

TRADE_TEXT = """
## The trade

Number of occluders, size of the map and threshold of compactness: the share of the hidden objects that is found, and
milliseconds of a frame for all steps, select to test, on the host; threads: {threads}. At map 1/2 a texel holds 2 x 2
pixels, at 1/4 it holds 4 x 4, and one triangle must cover them alone; the threshold is 0.5 there.
"""


def page(tables):
    effect = groups(tables["effect"])
    rows = tables["effect"] + tables["trade"]
    wrong = sum(r["wrong"] for r in rows)
    checked = sum(r["culled"] for r in rows)
    threads = sorted({f"{r['threads']:.0f}" for r in tables["trade"]})
    text = [
        "<!-- made by scripts/occlusion.py from occlusion.csv -->",
        "",
        *INTRODUCTION.strip().format(culled=checked, wrong=wrong).split("\n"),
        "",
        *effect_table(effect),
        "",
        "![what is found](../images/occlusion.svg)",
        "",
        *LIMITS_TEXT.strip().split("\n"),
        "",
        *limits_table(effect),
        "",
        *aim_text(effect),
        "",
        *BUYS_TEXT.strip().format(occluders=BUYS).split("\n"),
        "",
        *buys_table(effect),
        "",
        *TRADE_TEXT.strip().format(threads=", ".join(threads)).split("\n"),
        *trade_tables(tables["trade"]),
        "",
        "![the trade](../images/occlusion_trade.svg)",
    ]
    return "\n".join(text) + "\n"


# ---- the pictures ---------------------------------------------------------------------------------------------------

MARKS = (  # choice, occluders, label, colour, shape, radius
    ("every sample", None, "every sample", "#bbbbbb", "square", 5),
    ("every texel", None, "every texel", "#888888", "square", 5),
    ("all", None, "all in view", "#000000", "square", 5),
    ("temporal", 2000, "temporal, 2,000", "#c8571b", "circle", 8),
    ("temporal", 500, "temporal, 500", "#c8571b", "circle", 7),
    ("selected", 2000, "selected, 2,000", "#1f5fa8", "circle", 6),
    ("selected", 500, "500", "#1f5fa8", "circle", 5),
    ("selected", 100, "100", "#1f5fa8", "circle", 4),
    ("selected", 20, "20", "#1f5fa8", "circle", 3),
)


def svg_of(width, height, parts):
    head = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="Helvetica, Arial, sans-serif">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    return "\n".join([*head, *parts, "</svg>"]) + "\n"


def effect_picture(rows):
    by_scene = groups(rows)
    width, left, right, top, step = 1200, 330, 30, 104, 26
    height = top + step * len(by_scene) + 100

    def at_x(value):
        return left + (width - left - right) * value / 100

    bottom = top + step * len(by_scene)
    parts = [
        write(24, 32, "Share of the hidden objects that is found", 20, weight="bold"),
        write(24, 56, "From outside and inside each scene, by what the occluders are. Squares: everything is one, "
              "and the test reads 2 x 2 texels (black), every texel, every sample."),
        f'<rect x="{left}" y="{top}" width="{width - left - right}" height="{bottom - top}" fill="#fafafa" '
        'stroke="#999"/>',
    ]
    for tick in range(0, 101, 20):
        parts.append(line(at_x(tick), top, at_x(tick), bottom, "#888" if tick == 80 else "#ddd"))
        parts.append(write(at_x(tick), top - 8, f"{tick} %", 14, "middle"))
    for i, ((scene, objects, place), group) in enumerate(by_scene.items()):
        y = top + step * (i + 0.5)
        parts.append(write(left - 70, y + 5, scene_name(scene, objects) if place == "outside" else "", 15, "end"))
        parts.append(write(left - 10, y + 5, place, 13, "end", "#666"))
        if i > 0 and place == "outside":
            parts.append(line(24, y - step / 2, width - right, y - step / 2, "#ccc"))
        for choice, k, _, colour, shape, radius in MARKS:
            row = pick(group, choice, k)
            if row and row["hidden"]:
                parts.append(mark(shape, at_x(found(row)), y, radius, colour, True, "#ffffff"))
    x, y = 24, bottom + 36
    for _, _, label, colour, shape, radius in reversed(MARKS):
        parts.append(mark(shape, x + 8, y, radius, colour, True, "#ffffff"))
        parts.append(write(x + 20, y + 5, label, 14))
        x += 44 + 8.2 * len(label)
    return svg_of(width, height, parts)


def trade_picture(rows):
    panels = list(groups(rows).items())
    width, left, right, top, gap = 1200, 76, 24, 96, 40
    panel_height = 300
    columns = 2
    panel = (width - left - right - (columns - 1) * gap) / columns
    height = top + math.ceil(len(panels) / columns) * (panel_height + 76) + 50
    times = [milliseconds(r) for r in rows]
    low, high = math.floor(math.log2(min(times))), math.ceil(math.log2(max(times)))
    series = ((1, 0.5, "#1f5fa8", "map 1/1"), (2, 0.5, "#c8571b", "map 1/2"), (4, 0.5, "#7a7a7a", "map 1/4"),
              (1, 0.9, "#2e8b57", "map 1/1, at least 0.9 compact"))
    parts = [
        write(left, 32, "The trade: time of a frame's occlusion culling against what it finds", 20, weight="bold"),
        write(left, 56, "Each line: 5, 10, 20, 50, 100, 200, 500, 1,000, 2,000 occluders, compactness at least 0.5. "
              "Host, milliseconds; percent of the hidden objects."),
    ]
    for i, ((scene, objects, place), group) in enumerate(panels):
        x0 = left + (i % columns) * (panel + gap)
        y0 = top + (i // columns) * (panel_height + 76)

        def at_x(value, x0=x0):
            return x0 + panel * (math.log2(value) - low) / (high - low)

        def at_y(value, y0=y0):
            return y0 + panel_height * (1 - value / 100)

        parts.append(f'<rect x="{x0:.1f}" y="{y0}" width="{panel:.1f}" height="{panel_height}" fill="#fafafa" '
                     'stroke="#999"/>')
        parts.append(write(x0 + panel / 2, y0 - 10, f"{scene_name(scene, objects)} objects, {place}", 16, "middle",
                           weight="bold"))
        for power in range(low, high + 1):
            parts.append(line(at_x(2**power), y0, at_x(2**power), y0 + panel_height, "#ddd"))
            parts.append(write(at_x(2**power), y0 + panel_height + 20, f"{2.0**power:g}", 14, "middle"))
        for tick in range(0, 101, 20):
            parts.append(line(x0, at_y(tick), x0 + panel, at_y(tick), "#888" if tick == 80 else "#ddd"))
            if i % columns == 0:
                parts.append(write(x0 - 8, at_y(tick) + 5, f"{tick} %", 14, "end"))
        for scale, threshold, colour, _ in series:
            points = [(milliseconds(r), found(r)) for r in group
                      if (r["scale"], r["threshold"]) == (scale, threshold)]
            places = " ".join(f"{at_x(x):.1f},{at_y(y):.1f}" for x, y in points)
            parts.append(f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="2"/>')
            parts += [mark("circle", at_x(x), at_y(y), 4, colour, True) for x, y in points]
    x = left
    for _, _, colour, label in series:
        parts.append(line(x, height - 30, x + 26, height - 30, colour, 3))
        parts.append(write(x + 34, height - 25, label, 15))
        x += 70 + 8.5 * len(label)
    return svg_of(width, height, parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="only tell whether all are up to date")
    parser.add_argument("--csv", type=pathlib.Path, default=DOCS / "performance" / "occlusion.csv")
    parser.add_argument("--table", type=pathlib.Path, default=DOCS / "performance" / "occlusion.md")
    parser.add_argument("--pictures", type=pathlib.Path, default=DOCS / "images")
    options = parser.parse_args()

    tables = read(options.csv)
    stale = False
    made = (
        (options.table, page(tables)),
        (options.pictures / "occlusion.svg", effect_picture(tables["effect"])),
        (options.pictures / "occlusion_trade.svg", trade_picture(tables["trade"])),
    )
    for path, text in made:
        if not options.check:
            path.write_text(text, "utf-8")
        elif not path.exists() or path.read_text("utf-8") != text:
            print(f"{path} is not what {options.csv} says: run scripts/occlusion.py", file=sys.stderr)
            stale = True
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
