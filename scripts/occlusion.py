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
FINE = 2  # the refinement of the tables, the viewer's own


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


def pick(rows, choice, occluders=None, refinement=None):
    return next((r for r in rows if r["choice"] == choice and occluders in (None, r["occluders"])
                 and refinement in (None, r["refinement"])), None)


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


def total(by_scene, choice, occluders, refinement, measure):
    """The measure of the sums over all scenes and places."""
    picked = [pick(rows, choice, occluders, refinement) for rows in by_scene.values()]
    return measure({k: sum(r[k] for r in picked) for k in ("culled", "culled_hidden", "hidden", "no_sample")})


AIM = 80  # percent of the hidden objects


def reached(by_scene, choice, occluders, refinement):
    """In how many scenes and places the aim is reached."""
    shares = [found(pick(rows, choice, occluders, refinement)) for rows in by_scene.values()]
    return sum(share is not None and share >= AIM for share in shares)


def effect_table(by_scene):
    ways = [("selected", k, refinement) for refinement in (0, FINE) for k in SELECTED]
    counts = ("in_view", "seen", "hidden", "no_sample")

    def cells_of(rows):
        return [f"{rows[0][k]:,.0f}" for k in counts] + [percent(found(pick(rows, *way))) for way in ways]

    names = ["scene, objects", "cameras", "in view", "seen", "hidden", "no sample"]
    names += [f"2 x 2: {SELECTED[0]}", *(f"{k:,}" for k in SELECTED[1:])]
    names += [f"finer: {SELECTED[0]}", *(f"{k:,}" for k in SELECTED[1:])]
    sums = [f"{sum(rows[0][k] for rows in by_scene.values()):,.0f}" for k in counts]
    text = [*heading(names), *lines_of(by_scene, cells_of)]
    for label, cells in (
        ("all", sums + [percent(total(by_scene, *way, found)) for way in ways]),
        ("all, ratio", [""] * len(counts) + [percent(total(by_scene, *way, ratio)) for way in ways]),
        (f"at least {AIM} % found", [""] * len(counts) + [f"{reached(by_scene, *way)}" for way in ways]),
    ):
        text.append(f"| {label} | | " + " | ".join(cells) + " |")
    return text


LIMITS = (
    ("selected", 500, FINE, "selected, 500"),
    ("temporal", 500, FINE, "temporal, 500"),
    ("selected", 2000, FINE, "selected, 2,000"),
    ("temporal", 2000, FINE, "temporal, 2,000"),
    ("most seen", 500, FINE, "most seen, 500"),
    ("selected", 500, 4, "32 x 32, 500"),
    ("all of last", None, FINE, "all of last"),
    ("all", None, 0, "all in view, 2 x 2"),
    ("all", None, FINE, "all in view"),
    ("every texel", None, None, "every texel"),
    ("every sample", None, None, "every sample"),
)


def limits_table(by_scene):
    def cells_of(rows):
        chosen = pick(rows, "selected", 500, FINE)
        own = 100 * chosen["culled_occluders"] / chosen["culled"] if chosen["culled"] else None
        return [percent(own), *(percent(found(pick(rows, *way))) for *way, _ in LIMITS)]

    names = ["scene, objects", "cameras", "occluders", *(label for *_, label in LIMITS)]
    picked = [pick(rows, "selected", 500, FINE) for rows in by_scene.values()]
    own = 100 * sum(r["culled_occluders"] for r in picked) / sum(r["culled"] for r in picked)
    sums = [percent(own), *(percent(total(by_scene, *way, found)) for *way, _ in LIMITS)]
    return [
        *heading(names),
        *lines_of(by_scene, cells_of),
        "| all | | " + " | ".join(sums) + " |",
        f"| at least {AIM} % found | | | " + " | ".join(f"{reached(by_scene, *way)}" for *way, _ in LIMITS) + " |",
    ]


def buys_table(by_scene):
    def change(row, key):
        off, on = row[f"{key}_off"], row[f"{key}_on"]
        return f"{off:,.0f} → {on:,.0f} ({100 * (on / off - 1):+.0f} %)" if off else ""

    def cells_of(rows):
        row = pick(rows, "selected", BUYS, FINE)
        released = 100 * row["vertices_culled"] / row["vertices_in_view"] if row["vertices_in_view"] else 0
        cells = [f"{row['vertices_culled']:,.0f} ({released:.0f} %)", f"{row['budget']:,.0f}"]
        return cells + [change(row, key) for key in ("seen_vertices", "seen_triangles", "seen_drawn")]

    names = ["scene, objects", "cameras", "vertices released", "budget", "vertices of seen objects", "their triangles",
             "seen objects drawn"]
    return [*heading(names), *lines_of(by_scene, cells_of)]


def trade_row(rows, occluders, refinement=FINE, scale=1, threshold=0.5):
    key = (occluders, refinement, scale, threshold)
    return next((r for r in rows if (r["occluders"], r["refinement"], r["scale"], r["threshold"]) == key), None)


def tested(refinement):
    """What the test reads at most."""
    side = 2 ** (int(refinement) + 1)
    return f"{side} x {side}"


def trade_tables(rows):
    def cell(row):
        return f"{percent(found(row))} %, {figure(milliseconds(row))} ms"

    text = []
    for (scene, objects, place), group in groups(rows).items():
        plain = [r for r in group if (r["scale"], r["threshold"]) == (1, 0.5)]
        refinements = sorted({r["refinement"] for r in plain})
        numbers = sorted({r["occluders"] for r in plain})
        text += ["", f"{scene_name(scene, objects)} objects, {place}, by what the test reads at most:", ""]
        text += heading(["occluders", *(tested(r) for r in refinements)])
        for k in numbers:
            cells = [f"{k:,.0f}", *(cell(trade_row(group, k, refinement)) for refinement in refinements)]
            text.append("| " + " | ".join(cells) + " |")
        text += ["", "Of that, in milliseconds:", ""]
        text += heading(["occluders", "their triangles", "select", "depth", "map",
                         *(f"test, {tested(r)}" for r in refinements)])
        for k in numbers:
            row = trade_row(group, k)
            cells = [f"{k:,.0f}", f"{row['occluder_triangles'] / row['cameras']:,.0f}"]
            cells += [figure(row[step] / row["cameras"]) for step in ("ms_select", "ms_depth", "ms_hzm")]
            cells += [figure(trade_row(group, k, r)["ms_test"] / row["cameras"]) for r in refinements]
            text.append("| " + " | ".join(cells) + " |")
        text += ["", f"By map and threshold, {tested(FINE)}:", ""]
        ways = [(2, 0.5), (4, 0.5)] + [(1, t) for t in sorted({r["threshold"] for r in group})]
        text += heading(["occluders", *(f"map 1/{s}" if s > 1 else f"map 1/1, at least {t:g}" for s, t in ways)])
        for k in SELECTED:
            cells = [f"{k:,.0f}", *(cell(trade_row(group, k, FINE, *way)) for way in ways)]
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

*Found*, the share of the hidden objects that was culled, in percent, by number of occluders, which `select_occluders`
chooses among the objects with compactness at least 0.5; the map has the picture's size. *2 x 2*: the test reads the at
most 2 x 2 texels of the map that hold the box's rectangle. *Finer*: where these do not tell, those two levels below, at
most {fine}, up to the first that is not nearer: `refinement` {refinement} of `cull_occluded`, and what the viewer does.
*Ratio*: all culled objects to all that show nothing, hidden or without a sample ([Peng13] Table 4.4: 58.3 %). The last
line counts of the {rows} scenes and places those where at least {aim} % are found.
"""

LIMITS_TEXT = """
## What limits it

Found, in percent of the hidden objects, by other choices; with the finer test, if nothing else is said:

- *occluders*: of what 500 selected ones cull, those that are occluders themselves. They need not stay, since none
  hides itself: its depths are never nearer than its box;
- *temporal*: half of the occluders are chosen among what the last frame showed, 1/600 of the way before, the other half
  among what the first do not hide: `--occlusion temporal` of the viewer with half the number;
- *most seen*: the 500 objects that show the most samples, which only the truth knows;
- *32 x 32*: 500 selected ones, and the test goes down four levels;
- *all of last*: all that the last frame showed, with 4,000 temporal ones;
- *all in view*: all objects are occluders, and tested: the most that the test can find, with 2 x 2 texels and finer;
- *every texel*: the same, and the test reads every texel that the rectangle of the box, grown by a pixel, touches;
- *every sample*: only those whose centre is in the rectangle, and a rectangle with none shows nothing: what
  axis-aligned boxes can find at most.
"""

BUYS_TEXT = """
## What it buys

With {occluders} occluders selected and the finer test: the vertices of the culled objects at full detail, and what
`distribute_budget` (fair) gives to the objects that are seen, without and with culling. The budget is a tenth of the
vertices in view, at most a million a picture.
"""

TRADE_TEXT = """
## The trade

Number of occluders, refinement of the test, size of the map and threshold of compactness: the share of the hidden
objects that is found, and milliseconds of a frame for all steps, select to test, on the host; threads: {threads}. The
map has the picture's size and the threshold is 0.5, if nothing else is said. At map 1/2 a texel holds 2 x 2 pixels, at
1/4 it holds 4 x 4, and one triangle must cover them alone. All tests that differ in refinement alone read the same map,
drawn and timed once.
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
        *INTRODUCTION.strip().format(culled=checked, wrong=wrong, fine=tested(FINE), refinement=FINE,
                                     rows=len(effect), aim=AIM).split("\n"),
        "",
        *effect_table(effect),
        "",
        "![what is found](../images/occlusion.svg)",
        "",
        *LIMITS_TEXT.strip().split("\n"),
        "",
        *limits_table(effect),
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

MARKS = (  # choice, occluders, refinement, label, colour, shape, radius
    ("every sample", None, None, "every sample", "#bbbbbb", "square", 5),
    ("every texel", None, None, "every texel", "#888888", "square", 5),
    ("all", None, FINE, "all in view", "#000000", "square", 5),
    ("temporal", 2000, FINE, "temporal, 2,000", "#c8571b", "circle", 8),
    ("selected", 2000, FINE, "selected, 2,000", "#1f5fa8", "circle", 6),
    ("selected", 500, FINE, "500", "#1f5fa8", "circle", 5),
    ("selected", 100, FINE, "100", "#1f5fa8", "circle", 4),
    ("selected", 20, FINE, "20", "#1f5fa8", "circle", 3),
    ("selected", 500, 0, "selected, 500, 2 x 2", "#7fb2e5", "square", 4),
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
    width, left, right, top, step = 1200, 330, 30, 124, 26
    height = top + step * len(by_scene) + 100

    def at_x(value):
        return left + (width - left - right) * value / 100

    bottom = top + step * len(by_scene)
    parts = [
        write(24, 32, "Share of the hidden objects that is found", 20, weight="bold"),
        write(24, 56, "From outside and inside each scene, by what the occluders are. The test reads up to "
              f"{tested(FINE)} texels; light blue: only 2 x 2."),
        write(24, 76, "Black and grey: everything is an occluder, and the test reads up to "
              f"{tested(FINE)} texels (black), every texel, every sample."),
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
        for choice, k, refinement, _, colour, shape, radius in MARKS:
            row = pick(group, choice, k, refinement)
            if row and row["hidden"]:
                parts.append(mark(shape, at_x(found(row)), y, radius, colour, True, "#ffffff"))
    x, y = 24, bottom + 36
    for *_, label, colour, shape, radius in reversed(MARKS):
        parts.append(mark(shape, x + 8, y, radius, colour, True, "#ffffff"))
        parts.append(write(x + 20, y + 5, label, 14))
        x += 40 + 7.4 * len(label)
    return svg_of(width, height, parts)


def trade_picture(rows):
    panels = list(groups(rows).items())
    width, left, right, top, gap = 1200, 76, 24, 116, 40
    panel_height = 300
    columns = 2
    panel = (width - left - right - (columns - 1) * gap) / columns
    height = top + math.ceil(len(panels) / columns) * (panel_height + 76) + 50
    times = [milliseconds(r) for r in rows]
    low, high = math.floor(math.log2(min(times))), math.ceil(math.log2(max(times)))
    series = (  # refinement, scale, threshold, colour, label
        (0, 1, 0.5, "#7fb2e5", tested(0)),
        (FINE, 1, 0.5, "#1f5fa8", tested(FINE)),
        (4, 1, 0.5, "#6a3d9a", tested(4)),
        (FINE, 2, 0.5, "#c8571b", f"map 1/2, {tested(FINE)}"),
        (FINE, 4, 0.5, "#7a7a7a", f"map 1/4, {tested(FINE)}"),
        (FINE, 1, 0.9, "#2e8b57", f"at least 0.9 compact, {tested(FINE)}"),
    )
    parts = [
        write(left, 32, "The trade: time of a frame's occlusion culling against what it finds", 20, weight="bold"),
        write(left, 56, "By texels that the test reads at most, map and compactness. Dots: 5, 10, 20, 50, 100, 200, "
              "500, 1,000, 2,000 occluders, or 20, 100, 500, 2,000."),
        write(left, 76, "Host, milliseconds; percent of the hidden objects. If nothing else is said, the map has the "
              "picture's size and compactness is at least 0.5."),
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
        for *way, colour, _ in series:
            points = [(milliseconds(r), found(r)) for r in group
                      if [r["refinement"], r["scale"], r["threshold"]] == way]
            places = " ".join(f"{at_x(x):.1f},{at_y(y):.1f}" for x, y in points)
            parts.append(f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="2"/>')
            parts += [mark("circle", at_x(x), at_y(y), 4, colour, True) for x, y in points]
    x = left
    for *_, colour, label in series:
        parts.append(line(x, height - 30, x + 26, height - 30, colour, 3))
        parts.append(write(x + 34, height - 25, label, 15))
        x += 60 + 8 * len(label)
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
