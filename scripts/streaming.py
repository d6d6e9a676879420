#!/usr/bin/env python3
"""Measures what a transfer cap costs the picture, and makes the table and the curves of it.

streaming.py --viewer PROGRAM --model FILE.pgl   runs pgl_viewer, writes docs/performance/streaming.csv and the rest
streaming.py           writes docs/performance/streaming.md and docs/images/streaming.svg from the figures
streaming.py --check   writes nothing; exits with 1 where they are not what the figures say

The model is the plant (pgl_preprocess --objects 20000 -o FILE.pgl), or any: --camera and --up say from where. Only
bytes, counts and pictures are compared, no times. Options name other files. Nothing but Python's standard library is
needed.
"""

import argparse
import csv
import json
import math
import operator
import pathlib
import struct
import subprocess
import sys
import tempfile
import textwrap
import zlib

sys.dont_write_bytecode = True  # of the scripts beside this one

from accuracy import figure, line, mark, write  # noqa: E402
from occlusion import heading, svg_of  # noqa: E402

DOCS = pathlib.Path(__file__).resolve().parent.parent / "docs"
TEXTS = ("table", "place", "policy")
COLUMNS = ("table", "place", "policy", "budget", "share", "cap", "least_frames", "complete", "frame", "objects",
           "triangles", "bytes", "missing_bytes", "mean_missing", "rms", "differ")  # fmt: skip
BUDGETS = (100_000, 300_000, 1_000_000)
SHARES = (64, 16, 4, 1)  # of the whole transfer that the cap is: one n-th
SHOWN = (1, 2, 4, 8, 16, 32)  # frames whose pictures are compared
MOVING_BUDGET = 300_000
MOVING_SHARES = (64, 32, 16, 8, 4)
MOVING_FRAMES = 30
LAST = 10  # frames at the end of the way that the mean is of
SAME_SHARES = (2, 4, 16)  # of N, and of the whole transfer
SIZES = ("30000", "100000", "300000", "1000000", "3000000", "all")
POLICIES = ("exact", "fair")
NOTICED = 8  # levels of 255 that a pixel may differ by


class Wrong(Exception):
    """What was measured cannot be."""


# ---- pictures -------------------------------------------------------------------------------------------------------


def rows_of(png):
    """Width and rows of RGB bytes of a PNG with 8 bits a channel, no alpha, not interlaced."""
    if png[:8] != b"\x89PNG\r\n\x1a\n":
        raise Wrong("not a PNG")
    at, packed, header = 8, [], None
    while at < len(png):
        (length,), kind = struct.unpack_from(">I", png, at), png[at + 4 : at + 8]
        body = png[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed.append(body)
        at += 12 + length
    width, height, *form = header
    if form != [8, 2, 0, 0, 0]:
        raise Wrong("not a PNG of 8-bit RGB")
    data, stride = zlib.decompress(b"".join(packed)), 3 * width
    if len(data) != height * (stride + 1):
        raise Wrong("a PNG of another length than it says")
    above, rows = bytes(stride), []
    for y in range(height):
        start = y * (stride + 1)
        above = unfiltered(data[start], data[start + 1 : start + 1 + stride], above)
        rows.append(above)
    return width, rows


def unfiltered(kind, row, above):
    if kind == 0:
        return row
    if kind == 2:
        return bytes([(a + b) & 255 for a, b in zip(row, above, strict=True)])
    out = bytearray(row)
    for channel in range(3):
        left = corner = 0
        made = []
        if kind == 1:
            for value in row[channel::3]:
                left = (value + left) & 255
                made.append(left)
        elif kind == 3:
            for value, up in zip(row[channel::3], above[channel::3], strict=True):
                left = (value + ((left + up) >> 1)) & 255
                made.append(left)
        elif kind == 4:
            for value, up in zip(row[channel::3], above[channel::3], strict=True):
                to_left, to_up, to_corner = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
                if to_left <= to_up and to_left <= to_corner:
                    left = (value + left) & 255
                else:
                    left = (value + (up if to_up <= to_corner else corner)) & 255
                corner = up
                made.append(left)
        else:
            raise Wrong(f"a PNG with filter {kind}")
        out[channel::3] = bytes(made)
    return bytes(out)


def difference(one, other):
    """Of two pictures: root mean square of the differences of all channels, and the share of pixels where one channel
    differs by more than NOTICED, in percent."""
    (width, rows), (other_width, other_rows) = one, other
    if width != other_width or len(rows) != len(other_rows):
        raise Wrong("pictures of different sizes")
    squares = noticed = 0
    for a, b in zip(rows, other_rows, strict=True):
        if a == b:
            continue
        far = [abs(d) for d in map(operator.sub, a, b)]
        squares += sum(map(operator.mul, far, far))
        noticed += sum(map(NOTICED.__lt__, map(max, far[0::3], far[1::3], far[2::3])))
    pixels = width * len(rows)
    return math.sqrt(squares / (3 * pixels)), 100 * noticed / pixels


# ---- measuring ------------------------------------------------------------------------------------------------------


class Viewer:
    """Runs pgl_viewer, and compares what it draws."""

    def __init__(self, options, folder):
        self.folder = folder
        self.call = [str(options.viewer), str(options.model), "--headless", "--stream", "always", "--up", options.up,
                     "--size", options.size]  # fmt: skip
        self.places = {"inside": ["--camera=" + options.camera], "outside": []}
        self.stats = None

    def run(self, place, policy, budget, frames, cap=None, *more):
        """What --stats says, and the last frame's picture."""
        picture, stats = self.folder / "picture.png", self.folder / "stats.json"
        call = [*self.call, *self.places[place], "--policy", policy, "--budget", str(budget), "--frames", str(frames),
                "--output", str(picture), "--stats", str(stats), *more]  # fmt: skip
        if cap is not None:
            call += ["--transfer", str(cap)]
        try:
            done = subprocess.run(call, text=True, capture_output=True, check=False)
        except OSError as error:
            raise Wrong(f"{call[0]}: {error.strerror}") from error
        if done.returncode != 0:
            raise Wrong(done.stderr.strip() or f"{call[0]} ends with {done.returncode}")
        self.stats = json.loads(stats.read_text("utf-8"))
        sent = self.stats["stream"]["sent"]
        if len(sent) != frames:
            raise Wrong(f"{frames} frames asked for, {len(sent)} drawn")
        if cap is not None and max(frame["bytes"] for frame in sent) > cap:
            raise Wrong(f"a frame sends more than its cap of {cap} bytes")
        return self.stats, rows_of(picture.read_bytes())


def row_of(stats, against, picture, **more):
    rms, differ = difference(picture, against)
    drawn = stats["drawn"]
    return {"objects": drawn["objects"], "triangles": drawn["triangles"], "rms": f"{rms:.4f}",
            "differ": f"{differ:.4f}"} | more  # fmt: skip


def teleports(viewer, place, budget):
    """From nothing to a view."""
    stats, whole = viewer.run(place, "exact", budget, 1)
    size, checksum = stats["stream"]["sent"][0]["bytes"], stats["drawn"]["checksum"]
    for share in SHARES:
        cap = math.ceil(size / share)
        least = math.ceil(size / cap)
        frames = least + 1
        while True:
            stats, picture = viewer.run(place, "exact", budget, frames, cap)
            sent = stats["stream"]["sent"]
            if sent[-1]["missing_bytes"] == 0:
                break
            if sent[-1]["bytes"] == 0:
                raise Wrong(f"a cap of {cap} bytes is less than a single step")
            frames *= 2
        if sum(frame["bytes"] for frame in sent) != size or stats["drawn"]["checksum"] != checksum:
            raise Wrong("a still camera does not come to the frame without a cap, or sends something twice")
        complete = 1 + next(i for i, frame in enumerate(sent) if frame["missing_bytes"] == 0)
        known = {"table": "teleport", "place": place, "policy": "exact", "budget": budget, "share": share, "cap": cap,
                 "least_frames": least, "complete": complete}  # fmt: skip
        for frame in [*(f for f in SHOWN if f < complete), complete]:
            if frame == complete:
                now, shown = stats, picture
            else:
                now, shown = viewer.run(place, "exact", budget, frame, cap)
                if now["stream"]["sent"] != sent[:frame]:
                    raise Wrong("the same frames do not send the same")
            known |= {"frame": frame, "bytes": sum(f["bytes"] for f in sent[:frame]),
                      "missing_bytes": sent[frame - 1]["missing_bytes"]}  # fmt: skip
            yield row_of(now, whole, shown, **known)


def moves(viewer, place):
    """A camera that turns a degree a frame, from nothing."""
    ask = (place, "exact", MOVING_BUDGET, MOVING_FRAMES)
    stats, whole = viewer.run(*ask, None, "--orbit")
    size = stats["stream"]["sent"][0]["bytes"]
    for share in (None, *MOVING_SHARES):
        cap, picture = None, whole
        if share is not None:
            cap = math.ceil(size / share)
            stats, picture = viewer.run(*ask, cap, "--orbit")
        sent = stats["stream"]["sent"]
        mean = sum(frame["missing_bytes"] for frame in sent[-LAST:]) / LAST
        yield row_of(stats, whole, picture, table="moving", place=place, policy="exact", budget=MOVING_BUDGET,
                     share=share, cap=cap, frame=MOVING_FRAMES, bytes=sum(f["bytes"] for f in sent[1:]),
                     missing_bytes=sent[-1]["missing_bytes"], mean_missing=f"{mean:.0f}")  # fmt: skip


def same_bytes(viewer, place):
    """The first capped frame, and a budget that is smaller by as much: about as many bytes."""
    for policy in POLICIES:
        known = {"table": "same", "place": place, "policy": policy, "frame": 1}
        stats, whole = viewer.run(place, policy, MOVING_BUDGET, 1)
        size = stats["stream"]["sent"][0]["bytes"]
        for share in SAME_SHARES:
            cap = math.ceil(size / share)
            for budget, limit in ((MOVING_BUDGET, cap), (MOVING_BUDGET // share, None)):
                stats, picture = viewer.run(place, policy, budget, 1, limit)
                sent = stats["stream"]["sent"][0]
                yield row_of(stats, whole, picture, **known, budget=budget, share=share, cap=limit,
                             bytes=sent["bytes"], missing_bytes=sent["missing_bytes"])  # fmt: skip


def sizes(viewer, place):
    """Budgets without a cap."""
    for policy in POLICIES:
        whole = None
        for budget in reversed(SIZES):
            stats, picture = viewer.run(place, policy, budget, 1)
            whole = whole or picture
            vertices = stats["drawn"]["vertices"]
            yield row_of(stats, whole, picture, table="budget", place=place, policy=policy, frame=1,
                         budget=vertices if budget == "all" else budget,
                         bytes=stats["stream"]["sent"][0]["bytes"], missing_bytes=0)  # fmt: skip


def measure(options):
    with tempfile.TemporaryDirectory() as folder, options.csv.with_suffix(".part").open("w", encoding="utf-8") as file:
        viewer = Viewer(options, pathlib.Path(folder))
        rows = []

        def take(some):
            for row in some:
                rows.append(row)
                print(*(f"{k}={v}" for k, v in row.items() if v is not None), file=sys.stderr)

        for place in viewer.places:
            take(sizes(viewer, place))
        take(moves(viewer, "inside"))
        take(same_bytes(viewer, "inside"))
        for budget in BUDGETS:
            for place in viewer.places:
                take(teleports(viewer, place, budget))
        model, gl = viewer.stats["model"], viewer.stats["gl"]
        about = {
            "model": f"{viewer.stats['objects']:,} objects, {model['vertices']:,} vertices, "
                     f"{model['triangles']:,} triangles",
            "inside": options.camera,
            "up": options.up,
            "size": options.size,
            "renderer": f"{gl['renderer']}, {gl['version']}, {gl['samples']} samples a pixel",
        }  # fmt: skip
        file.writelines(f"# {key}: {value}\n" for key, value in about.items())
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    options.csv.with_suffix(".part").replace(options.csv)


def read(path):
    """What is said about the run, and the rows by table; numbers are floats, None where the field is empty."""
    about, tables = {}, {"teleport": [], "moving": [], "budget": [], "same": []}
    lines = path.read_text("utf-8").splitlines()
    for text in lines:
        if text.startswith("# "):
            key, value = text[2:].split(": ", 1)
            about[key] = value
    for row in csv.DictReader(text for text in lines if not text.startswith("# ")):
        numbers = {k: float(v) if v else None for k, v in row.items() if k not in TEXTS}
        tables[row["table"]].append({k: row[k] for k in TEXTS} | numbers)
    return about, tables


# ---- the page -------------------------------------------------------------------------------------------------------


def kib(value):
    return f"{value / 1024:,.0f}"


def cell(row):
    return f"{figure(row['rms'], 3)} ({row['differ']:.1f} %)"


def share_name(share):
    return "none" if share is None else "all" if share == 1 else f"1/{share:.0f}"


def groups(rows, *keys):
    """The rows by those columns, in their order."""
    found = {}
    for row in rows:
        found.setdefault(tuple(row[k] for k in keys), []).append(row)
    return found


def teleport_table(rows):
    text = heading(["camera", "N", "whole, KiB", "cap", "KiB", "frames, at least", "frames",
                    *(f"after {f}" for f in SHOWN)])  # fmt: skip
    for (place, budget, share), group in groups(rows, "place", "budget", "share").items():
        first, by_frame = group[0], {r["frame"]: r for r in group}
        cells = [place, f"{budget:,.0f}", kib(group[-1]["bytes"]), share_name(share), kib(first["cap"]),
                 f"{first['least_frames']:.0f}", f"{first['complete']:.0f}"]  # fmt: skip
        for frame in SHOWN:
            cells.append("" if frame > first["complete"] else cell(by_frame[frame]))
        text.append("| " + " | ".join(cells) + " |")
    return text


def moving_table(rows):
    text = heading(["cap", "KiB", "sent a frame after the first, KiB", f"missing, last {LAST} frames, KiB",
                    "last frame, KiB", "difference of the last frame"])  # fmt: skip
    for row in rows:
        cells = [share_name(row["share"]), "" if row["cap"] is None else kib(row["cap"]),
                 kib(row["bytes"] / (MOVING_FRAMES - 1)), kib(row["mean_missing"]), kib(row["missing_bytes"]),
                 cell(row)]  # fmt: skip
        text.append("| " + " | ".join(cells) + " |")
    return text


def same_table(rows):
    text = heading(["policy", "share", "capped: KiB", "objects", "difference", "smaller N", "KiB", "objects",
                    "difference"])  # fmt: skip
    for (policy, share), (capped, smaller) in groups(rows, "policy", "share").items():
        cells = [policy, share_name(share), kib(capped["bytes"]), f"{capped['objects']:,.0f}", cell(capped),
                 f"{smaller['budget']:,.0f}", kib(smaller["bytes"]), f"{smaller['objects']:,.0f}",
                 cell(smaller)]  # fmt: skip
        text.append("| " + " | ".join(cells) + " |")
    return text


def budget_table(rows):
    text = heading(["camera", "policy", "N", "objects", "triangles", "KiB", "difference"])
    for row in rows:
        cells = [row["place"], row["policy"], f"{row['budget']:,.0f}", f"{row['objects']:,.0f}",
                 f"{row['triangles']:,.0f}", kib(row["bytes"]), cell(row)]  # fmt: skip
        text.append("| " + " | ".join(cells) + " |")
    return text


def words(*parts):
    return textwrap.fill(" ".join(parts), 118, break_long_words=False, break_on_hyphens=False)


def after(rows, place, budget, share, frame):
    """The difference, where that was measured: "61.4 (48.0 %)"."""
    return next(cell(r) for r in rows
                if [r["place"], r["budget"], r["share"], r["frame"]] == [place, budget, share, frame])  # fmt: skip


def page(about, tables):
    teleport, moved = tables["teleport"], tables["moving"][0]
    late = [r["complete"] - r["least_frames"] for r in teleport if r["frame"] == r["complete"]]
    told = MOVING_BUDGET, SHARES[1]
    return "\n".join([
        "<!-- made by scripts/streaming.py from streaming.csv -->",
        "",
        "# What a transfer cap costs the picture",
        "",
        words("`--transfer` caps the bytes that a streamed frame sends; what the selection wants beyond that arrives",
              "with the next frames, the most visible first. Here capped frames are compared to the frame of the same",
              "camera without a cap, and small budgets to the largest."),
        "",
        "    pgl_preprocess --objects 20000 -o plant.pgl",
        "    scripts/streaming.py --viewer pgl_viewer --model plant.pgl",
        "",
        words(f"Model: {about['model']}. Pictures: {about['size']}, {about['renderer']}. Inside is",
              f"`--camera={about['inside']} --up {about['up']}`; outside the whole model is in the picture. The",
              "backend is the host. The policy is `exact` where none is said. A difference is the root mean square",
              "over all pixels of the 8-bit RGB values and, in brackets, the share of pixels of which a value differs",
              f"by more than {NOTICED}. No figure depends on how fast the machine is."),
        "",
        "![difference by frames, caps and budgets](../images/streaming.svg)",
        "",
        "## Teleport",
        "",
        words("From nothing to a view that stays. *Whole* is what the frame without a cap sends, the cap a share of",
              f"it. No cap can do with fewer frames than *at least*, whole / cap rounded up; none of these {len(late)}",
              f"took more than {max(late):.0f} more. After the last frame what is drawn has the checksum of the",
              "frame without a cap, the bytes sent are as many, and no frame sent more than its cap: the",
              "script stops if one of these is not so."),
        "",
        words("Every object in a capped frame is whole, only coarser, and those that wait are the lightest. With N =",
              f"{told[0]:,} and a cap of 1/{told[1]} the difference inside is",
              f"{after(teleport, 'inside', *told, 1)} after the first frame,",
              f"{after(teleport, 'inside', *told, 4)} after 4 and {after(teleport, 'inside', *told, 8)} after 8.",
              "It does not fall evenly: once all have their fewest vertices, objects are finished one after another,",
              "the heaviest first, and the curves are flat while those grow of which the picture shows little."),
        "",
        *teleport_table(teleport),
        "",
        "## Moving",
        "",
        words("The camera inside, turned around its target by a degree a frame for "
              f"{MOVING_FRAMES} frames, from nothing; N is {MOVING_BUDGET:,}. Without a cap the first frame sends all,",
              f"and the others {kib(moved['bytes'] / (MOVING_FRAMES - 1))} KiB each in the mean. Caps are shares of",
              "what the first one sends."),
        "",
        *moving_table(tables["moving"]),
        "",
        "## A cap or a smaller N",
        "",
        words(f"The first frame from nothing, inside, N = {MOVING_BUDGET:,}, under a cap, and what a budget smaller by",
              "that share draws without a cap, about as many bytes: both against the frame of N without a cap."),
        "",
        *same_table(tables["same"]),
        "",
        "## Budgets",
        "",
        "No cap, by N, against the frame of all vertices of the objects in view (the first line of each).",
        "",
        *budget_table(tables["budget"]),
        "",
    ])  # fmt: skip


# ---- the picture ----------------------------------------------------------------------------------------------------

COLOURS = {64: "#c8571b", 32: "#d69a2d", 16: "#1f5fa8", 8: "#6a3d9a", 4: "#2e8b57", 1: "#7a7a7a"}
WIDTH, LEFT, TOP, GAP_X, GAP_Y, PANEL_Y = 1200, 70, 122, 62, 92, 230
PANEL_X = (WIDTH - LEFT - 24 - 2 * GAP_X) / 3


def step_of(high):
    """A round step that cuts [0, high] into at most 5."""
    base = 10 ** math.floor(math.log10(high / 5))
    return next(base * k for k in (1, 2, 5, 10) if base * k >= high / 5)


def panel(column, row, title, below, ticks, low, high, top, curves):
    """Curves (colour, dash, points) over a logarithmic axis with ticks {value: label}."""
    x0, y0 = LEFT + column * (PANEL_X + GAP_X), TOP + row * (PANEL_Y + GAP_Y)
    step = step_of(top)
    top = step * math.ceil(top / step)

    def at_x(value):
        return x0 + PANEL_X * math.log(value / low) / math.log(high / low)

    def at_y(value):
        return y0 + PANEL_Y * (1 - value / top)

    parts = [
        f'<rect x="{x0:.1f}" y="{y0}" width="{PANEL_X:.1f}" height="{PANEL_Y}" fill="#fafafa" stroke="#999"/>',
        write(x0 + PANEL_X / 2, y0 - 10, title, 16, "middle", weight="bold"),
        write(x0 + PANEL_X / 2, y0 + PANEL_Y + 40, below, 14, "middle"),
    ]
    for value, label in ticks.items():
        parts.append(line(at_x(value), y0, at_x(value), y0 + PANEL_Y, "#ddd"))
        parts.append(write(at_x(value), y0 + PANEL_Y + 20, label, 13, "middle"))
    for i in range(round(top / step) + 1):
        parts.append(line(x0, at_y(i * step), x0 + PANEL_X, at_y(i * step), "#ddd"))
        parts.append(write(x0 - 8, at_y(i * step) + 5, f"{i * step:g}", 13, "end"))
    for colour, dash, points in curves:
        places = " ".join(f"{at_x(x):.1f},{at_y(y):.1f}" for x, y in points)
        parts.append(f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="2"'
                     + (f' stroke-dasharray="{dash}"' if dash else "") + "/>")  # fmt: skip
        parts += [mark("circle", at_x(x), at_y(y), 4, colour, not dash) for x, y in points]
    return parts


def picture(tables):
    rows = tables["teleport"]
    parts = [
        write(LEFT, 32, "A transfer cap and N against the difference to the frame without a cap", 20, weight="bold"),
        write(LEFT, 56, "Difference: root mean square of 8-bit RGB over all pixels. Above: a teleport, from nothing to "
              "a view that stays, N vertices;"),
        write(LEFT, 76, "the cap is a share of the whole transfer. Each curve ends where nothing is missing any more."),
    ]  # fmt: skip
    last = 2 ** math.ceil(math.log2(max(r["frame"] for r in rows)))
    frames = {2**i: f"{2**i}" for i in range(round(math.log2(last)) + 1)}
    for r, (_, of_place) in enumerate(groups(rows, "place").items()):
        top = max(row["rms"] for row in of_place)
        for c, ((place, budget), group) in enumerate(groups(of_place, "place", "budget").items()):
            curves = [(COLOURS[share], "", [(row["frame"], row["rms"]) for row in some])
                      for (share,), some in groups(group, "share").items()]  # fmt: skip
            parts += panel(c, r, f"{place}, N = {budget:,.0f}", "after so many frames", frames, 1, last, top, curves)
    moving = [row for row in tables["moving"] if row["share"]]
    caps = {row["cap"]: kib(row["cap"]) for row in moving}
    low, high = min(caps), max(caps)
    below = f"cap, KiB; N = {MOVING_BUDGET:,}, a degree a frame"
    for c, (key, scale, title) in enumerate((("rms", 1, "moving: difference of the last frame"),
                                             ("mean_missing", 1024, "moving: KiB missing"))):  # fmt: skip
        points = [(row["cap"], row[key] / scale) for row in moving]
        parts += panel(c, 2, title, below, caps, low, high, max(1, *(y for _, y in points)), [("#1f5fa8", "", points)])
    curves = []
    for (place, policy), some in groups(tables["budget"], "place", "policy").items():
        points = [(row["budget"], row["rms"]) for row in some if row["budget"] <= 3e6]
        curves.append(({"inside": "#1f5fa8", "outside": "#c8571b"}[place], "6 4" if policy == "fair" else "", points))
    ticks = {30e3: "30 k", 100e3: "100 k", 300e3: "300 k", 1e6: "1 M", 3e6: "3 M"}
    parts += panel(2, 2, "no cap: difference to all", "N; blue inside, orange outside; dashed: fair", ticks, 30e3, 3e6,
                   max(y for _, _, points in curves for _, y in points), curves)  # fmt: skip
    height = TOP + 3 * (PANEL_Y + GAP_Y)
    x = LEFT
    for share in SHARES:
        parts.append(line(x, height - 16, x + 26, height - 16, COLOURS[share], 3))
        label = "cap: all of it" if share == 1 else f"cap: 1/{share} of it"
        parts.append(write(x + 34, height - 11, label, 15))
        x += 170
    return svg_of(WIDTH, height + 8, parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="only tell whether all are up to date")
    parser.add_argument("--viewer", type=pathlib.Path, help="pgl_viewer: measure")
    parser.add_argument("--model", type=pathlib.Path, help="what it shows, a .pgl file")
    parser.add_argument("--camera", default="-20,-12,2,-5,-4,3,60", help="where inside is [%(default)s]")
    parser.add_argument("--up", default="z", help="the axis that points up [%(default)s]")
    parser.add_argument("--size", default="960x540", help="pixels [%(default)s]")
    parser.add_argument("--csv", type=pathlib.Path, default=DOCS / "performance" / "streaming.csv")
    parser.add_argument("--table", type=pathlib.Path, default=DOCS / "performance" / "streaming.md")
    parser.add_argument("--picture", type=pathlib.Path, default=DOCS / "images" / "streaming.svg")
    options = parser.parse_args()

    if (options.viewer is None) != (options.model is None):
        parser.error("--viewer and --model go together")
    if options.viewer:
        if options.check:
            parser.error("--check measures nothing")
        try:
            measure(options)
        except Wrong as error:
            options.csv.with_suffix(".part").unlink()
            print(f"streaming.py: {error}", file=sys.stderr)
            return 1
    about, tables = read(options.csv)
    stale = False
    for path, made in ((options.table, page(about, tables)), (options.picture, picture(tables))):
        if not options.check:
            path.write_text(made, "utf-8")
        elif not path.exists() or path.read_text("utf-8") != made:
            print(f"{path} is not what {options.csv} says: run scripts/streaming.py", file=sys.stderr)
            stale = True
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
