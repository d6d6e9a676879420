#!/usr/bin/env python3
"""Makes the tables and the picture of tiles for several GPUs from what bench/tile_study printed.

tiles.py           writes docs/performance/tiles.md and docs/images/tiles.svg
tiles.py --check   writes nothing; exits with 1 where they are not what the figures say

The figures are docs/performance/tiles.csv, the output of tile_study; what a GPU takes for its own work is read from
docs/performance/h200.json. Options name other files. Nothing but Python's standard library is needed.
"""

import argparse
import csv
import json
import math
import pathlib
import re
import sys
import textwrap

sys.dont_write_bytecode = True  # of the scripts beside this one

from accuracy import figure, line, mark, write  # noqa: E402
from occlusion import heading, svg_of  # noqa: E402

DOCS = pathlib.Path(__file__).resolve().parent.parent / "docs"
METHODS = ("grid", "static", "even", "dynamic", "ideal")
PLACES = ("around", "flight")

# What is assumed where nothing was measured.
TRIANGLES_PER_MS = 0.5e6  # small triangles that OpenGL draws
PEER_BYTES_PER_MS = 390e6  # from GPU to GPU of one machine
NETWORK_BYTES_PER_MS = 12.5e6  # from machine to machine, all to one
GPUS_A_MACHINE = 8
PICTURE = (3840, 2160)


def read(path):
    """The rows by table; numbers are floats, None where the field is empty."""
    tables = {name: [] for name in ("adapt", "flight", "frame", "trade", "growth")}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            numbers = {k: float(v) if v else None for k, v in row.items() if k not in ("table", "mode")}
            tables[row["table"]].append(numbers | {"mode": row["mode"]})
    return tables


def one(rows, **known):
    """The row with these values."""
    return next(row for row in rows if all(row[k] == v for k, v in known.items()))


def values(rows, key):
    return sorted({row[key] for row in rows})


def percent(part, whole=1.0, digits=1):
    return f"{100 * part / whole:.{digits}f} %" if whole and part is not None else ""


def words(*parts):
    return textwrap.fill(" ".join(parts), 118, break_long_words=False, break_on_hyphens=False)


def item(*parts):
    return "- " + words(*parts).replace("\n", "\n  ")


def row_of(*cells):
    return "| " + " | ".join(cells) + " |"


# ---- the tables -----------------------------------------------------------------------------------------------------


def adapt_tables(rows):
    times = heading(["selection", "tiles and threads", "adapt_tiles, ms", "one selection, ms", "ratio",
                     "adapt_tiles on one thread, ms"])  # fmt: skip
    kept = heading(["selection", "tiles", "objects in view", "in several tiles", "selected", "after unify",
                    "lost to unify", "vertices, of one selection's", "objects drawn by one selection",
                    "after unify"])  # fmt: skip
    for row in rows:
        if row["threads"] != row["gpus"]:
            continue
        alone = one(rows, mode=row["mode"], gpus=row["gpus"], threads=1)
        times.append(row_of(row["mode"], f"{row['gpus']:.0f}", figure(row["ms"]), figure(row["ms_plain"]),
                            f"{row['ms'] / row['ms_plain']:.2f}", figure(alone["ms"])))  # fmt: skip
        whole = row["budget"]
        kept.append(row_of(row["mode"], f"{row['gpus']:.0f}", f"{row['in_view']:,.0f}",
                           percent(row["shared"], row["in_view"]),
                           percent(row["selected"], whole) if whole else f"{row['selected']:,.0f}",
                           percent(row["in_tiles"], whole) if whole else f"{row['in_tiles']:,.0f}",
                           percent(row["selected"] - row["in_tiles"], whole) if whole else "",
                           percent(row["unified"], row["vertices"]), f"{row['drawn']:,.0f}",
                           f"{row['drawn_unified']:,.0f}"))  # fmt: skip
    return times, kept


def flight_table(rows):
    text = heading(["GPUs", "slow by", *(f"{m}: mean, ms" for m in METHODS), "worst, grid", "worst, dynamic",
                    "late, grid", "late, static", "late, even", "late, dynamic", "recovers after", "grid / dynamic"])
    for gpus in values(rows, "gpus"):
        if gpus == 1:
            continue
        for slow in values(rows, "slow"):
            by = {m: one(rows, gpus=gpus, slow=slow, mode=m) for m in METHODS}
            dynamic = by["dynamic"]
            recover = "never" if dynamic["recover"] is None else f"{dynamic['recover']:.0f}"
            text.append(row_of(f"{gpus:.0f}", f"{slow:g}", *(figure(by[m]["ms_mean"]) for m in METHODS),
                               figure(by["grid"]["ms_worst"]), figure(dynamic["ms_worst"]),
                               *(f"{by[m]['late']:.0f}" for m in METHODS[:4]), recover,
                               f"{by['grid']['ms_mean'] / dynamic['ms_mean']:.2f}"))  # fmt: skip
    return text


def way_name(row):
    if row["mode"] == "bisection":
        return f"bisection, LBT {row['lbt']:g}"
    return f"histogram, {row['bins']:.0f} bins" if row["bins"] else "histogram, every pixel"


def trade_table(rows):
    gpus = values(rows, "gpus")
    text = heading(["policy", *(f"{n:.0f} GPUs" for n in gpus)])
    for first in (row for row in rows if row["gpus"] == gpus[0]):
        cells = []
        for n in gpus:
            row = one(rows, gpus=n, mode=first["mode"], bins=first["bins"], lbt=first["lbt"])
            cells.append(f"{figure(row['ms'])} ms, {percent(row['imbalance'])}, +{percent(row['more'], 1, 0)}")
        text.append(row_of(way_name(first), *cells))
    return text


def growth_table(rows):
    text = heading(["GPUs", "objects", *(f"{p}: {what}" for p in PLACES for what in (
        "drawn", "in several tiles", "triangles more", "largest above the mean",
        "largest / equal share"))])  # fmt: skip
    for gpus in values(rows, "gpus"):
        cells = []
        for place in PLACES:
            row = one(rows, gpus=gpus, mode=place)
            cells += [f"{row['drawn'] / row['frames']:,.0f}", percent(row["shared"], row["drawn"]),
                      percent(row["triangles_in"] / row["triangles"] - 1),
                      percent(row["largest"] * gpus / row["triangles_in"] - 1),
                      f"{row['largest'] * gpus / row['triangles']:.2f}"]  # fmt: skip
        text.append(row_of(f"{gpus:.0f}", f"{one(rows, gpus=gpus, mode=PLACES[0])['objects']:,.0f}", *cells))
    return text


# ---- what it would take ---------------------------------------------------------------------------------------------


class Predicted:
    """The milliseconds of a frame of N GPUs, each with as many objects and vertices as the H200 was measured with."""

    def __init__(self, measured, growth):
        self.rows = {row["name"]: row for row in measured["rows"]}
        self.measured = measured
        self.shares = {p: {row["gpus"]: row["largest"] * row["gpus"] / row["triangles"] for row in growth
                           if row["mode"] == p} for p in PLACES}  # fmt: skip
        self.shares["corner"] = {1: 1.0}
        for name, row in self.rows.items():
            found = re.fullmatch(r"the largest load is ([\d.]+) of the mean one, all are ([\d.]+) of one GPU's",
                                 row.get("note", ""))  # fmt: skip
            whole = re.fullmatch(r"balance/(\d+)", name)
            if found and whole:
                self.shares["corner"][int(whole[1])] = float(found[1]) * float(found[2])

    def ms(self, name):
        return self.rows[name]["ms"]

    def balance(self, gpus):
        known = sorted((int(name[8:]), row["ms"]) for name, row in self.rows.items()
                       if re.fullmatch(r"balance/\d+", name))  # fmt: skip
        for (low, low_ms), (high, high_ms) in zip(known, known[1:]):
            if low <= gpus <= high:
                part = math.log(gpus / low) / math.log(high / low)
                return low_ms + part * (high_ms - low_ms)
        raise ValueError(gpus)

    def select(self):
        return self.ms("cull_frustum + project + distribute_budget + lay_out")

    def parts(self, gpus, place, grows=True):
        """For each step: what every GPU does for all objects, what it does for its own, and the picture. Each GPU has
        as many objects as were measured, or all together have."""
        models = gpus if grows else 1
        share = self.shares[place][gpus] * models / gpus
        split = self.balance(gpus) + self.ms("in_tile") if gpus > 1 else 0.0
        all_bytes = 4 * PICTURE[0] * PICTURE[1] / gpus
        peers = min(gpus, GPUS_A_MACHINE) - 1
        return {
            "select": models * self.select(),
            "split": models * split,
            "own": share * (self.ms("frame/streamed/exact") - self.select()),
            "draw": share * self.measured["triangles_drawn"] / TRIANGLES_PER_MS,
            "picture": peers * all_bytes / PEER_BYTES_PER_MS
            + max(0, gpus - GPUS_A_MACHINE) * all_bytes / NETWORK_BYTES_PER_MS,
        }

    def gain(self, gpus, place, grows, *but):
        """The time of one GPU over that of N, without some steps; None where one takes none."""

        def total(n):
            return sum(ms for step, ms in self.parts(n, place, grows).items() if step not in but)

        return total(1) / total(gpus) if total(1) else None

    def efficiency(self, gpus, place, *but):
        return self.gain(gpus, place, True, *but)


STEPS = ("select", "split", "own part", "draw", "picture", "frame, ms")


def steps_of(parts):
    return [*(figure(ms) for ms in parts.values()), figure(sum(parts.values()))]


def predicted_table(predicted):
    text = heading(["cameras", "GPUs", *STEPS, "efficiency", "without drawing"])
    for place, shares in predicted.shares.items():
        for gpus in sorted(shares):
            text.append(row_of(place, f"{gpus:.0f}", *steps_of(predicted.parts(gpus, place)),
                               percent(predicted.efficiency(gpus, place), 1, 0),
                               percent(predicted.efficiency(gpus, place, "draw"), 1, 0)))  # fmt: skip
    return text


def fixed_table(predicted):
    text = heading(["GPUs", *STEPS, "times as fast", "without drawing", "without drawing and picture"])
    for gpus in sorted(predicted.shares["corner"]):
        gains = [predicted.gain(gpus, "corner", False, *but) for but in ((), ("draw",), ("draw", "picture"))]
        text.append(row_of(f"{gpus:.0f}", *steps_of(predicted.parts(gpus, "corner", False)),
                           *("" if gain is None else f"{gain:.2f}" for gain in gains)))  # fmt: skip
    return text


# ---- the page -------------------------------------------------------------------------------------------------------


def page(tables, measured):
    adapt, flight, growth = tables["adapt"], tables["flight"], tables["growth"]
    predicted = Predicted(measured, growth)
    times, kept = adapt_tables(adapt)
    objects = f"{adapt[0]['objects']:,.0f}"
    frames, event = flight[0]["frames"], flight[0]["frame"]
    largest = max(values(growth, "gpus"))
    per_gpu = one(growth, gpus=1, mode=PLACES[0])["objects"]
    alone = one(flight, gpus=1, mode="grid")
    lost = [one(adapt, mode=mode, gpus=4, threads=4) for mode in ("exact", "fair")]

    def dynamic(gpus, slow):
        return one(flight, gpus=gpus, slow=slow, mode="dynamic")

    def gain(gpus, slow):
        return one(flight, gpus=gpus, slow=slow, mode="grid")["ms_mean"] / dynamic(gpus, slow)["ms_mean"]

    def share(place, gpus):
        return predicted.shares[place][gpus]

    h200 = ", ".join(f"{figure(predicted.ms(name))} ms ({label})" for name, label in (
        ("balance/2", "every pixel"), ("balance/2/64 bins", "64 bins"),
        ("balance/2/bisection", "bisection")))  # fmt: skip
    both = predicted.parts(largest, "flight")
    text = [
        "<!-- made by scripts/tiles.py from tiles.csv and h200.json -->",
        "",
        "# Tiles for several GPUs",
        "",
        words("What it costs to select tile by tile, what tiles that follow the measured times even out, what bins and",
              "thresholds of `balance` are worth, and how far tiles carry when the model grows with the GPUs. Times of",
              "the host are those of 2 cores of an AMD EPYC that other work shares, each the least of several, on one",
              "thread those of the processor; GPUs are simulated as each section says. The model is the plant of",
              f"{objects} objects, if nothing else is said, the picture {1920} x {1080}, and the budget 15 vertices an",
              "object. *Flight*: cameras on `--fly` of the viewer, from outside through the plant.",),
        "",
        f"    tile_study --objects {adapt[0]['objects']:.0f} > docs/performance/tiles.csv",
        "    scripts/tiles.py",
        "",
        "![tiles on a flight, and growth](../images/tiles.svg)",
        "",
        "## A thread for each tile",
        "",
        words("[NC07] Table 1, our reading: `adapt_tiles` with as many tiles as threads, against one selection for the",
              "whole picture on as many threads; frustum culling and projection come before both and are not in the",
              f"times. Means over {adapt[0]['frames']:.0f} cameras of the flight. *quality*: `select_by_error`, one",
              "pixel; its counts are those of the one selection for any tiles, or the study stops. *exact*, *fair*:",
              "`distribute_budget` with that policy, each tile with an equal part of the budget, unified by the",
              "smallest count. Four threads have two cores here."),
        "",
        *times,
        "",
        words("A thread for each tile is slower than one selection on the same threads, by *ratio*: each goes through",
              "all objects to find its own, and every object in several tiles is selected in each. It is worth its",
              "time only where tiles need budgets or thresholds of their own."),
        "",
        words("What is drawn, in sums over the cameras. An object in several tiles counts in each, in *selected* and",
              "*after unify* too, which are shares of the budget where there is one:"),
        "",
        *kept,
        "",
        words("With four tiles unify takes away, of what the tiles selected,",
              " and ".join(f"{percent(r['selected'] - r['in_tiles'], r['budget'])} of the budget (`{r['mode']}`)"
                           for r in lost) + ".",
              "More goes to objects that are drawn more than once: the picture has",
              " and ".join(percent(r["unified"], r["vertices"]) for r in lost),
              "of the vertices of one selection. An object that one of its tiles leaves out is left out by all; a tile",
              "with little to draw draws objects that one selection leaves out."),
        "",
        "## Static and dynamic tiles",
        "",
        words("[NC07] Table 2, our reading, with simulated GPUs: one takes 50 ns a triangle of its tile and 0.5 ms a",
              f"frame, and from frame {event:.0f} on the first one is slower by the factor. All draw the same counts.",
              f"Figures are of the {frames:.0f} frames from there on; one GPU alone takes",
              f"{figure(alone['ms_mean'])} ms a frame. *grid*: equal rectangles; *static*: what",
              "`balance` made of the first frame; *even*: `balance`",
              "in each frame, with equal weights; *dynamic*: `balance` with the weights of `next_weights`, from the",
              "times of the frame before, each off by up to 5 %; *ideal*: `balance` with the true speeds as weights.",
              "*Late* are the frames that take more than 10 % longer than ideal, and dynamic tiles have recovered with",
              "the first of ten in a row that do not."),
        "",
        *flight_table(flight),
        "",
        words(f"With one GPU slower by 2, dynamic tiles are {gain(2, 2):.2f} (2 GPUs), {gain(4, 2):.2f} (4) and",
              f"{gain(8, 2):.2f} (8) times as fast as the grid; by 4, {gain(2, 4):.2f}, {gain(4, 4):.2f} and",
              f"{gain(8, 4):.2f}. The times that the weights follow have the constant part in them, so a frame that",
              "shows nearly nothing misleads them: where the flight comes out of such frames, before the GPU slows",
              "down in the picture above, dynamic tiles take some frames to be right again."),
        "",
        "## Bins and thresholds",
        "",
        words("Equal GPUs: the time of `balance` on one core, how much the largest load is above the mean one, and how",
              "many triangles are drawn more than by one GPU, since their objects are in several tiles. Means over",
              f"{tables['trade'][0]['frames']:.0f} cameras of the flight. On an H200, with {measured['objects']:,}",
              f"objects and two GPUs, it takes {h200}."),
        "",
        *trade_table(tables["trade"]),
        "",
        words("Candidates at every pixel cost little more than few bins. A larger threshold saves no time, since a",
              "step of the search reads two sums, and with 0 it ends at a cut as good as the histogram's."),
        "",
        "## Growth",
        "",
        words(f"Plants of {per_gpu:,.0f} objects for each of N equal GPUs, cut by `balance`; means over",
              f"{growth[0]['frames']:.0f} cameras. *around*: the whole plant in the picture. *Largest / equal share*:",
              "the triangles of the busiest GPU over those of the picture by N; no efficiency is above one over it."),
        "",
        *growth_table(growth),
        "",
        words("What that would make of a frame, if each GPU were the H200 of",
              f"[h200.json](h200.json), with {measured['objects']:,} objects and {measured['budget']:,} vertices for",
              "each. Assumed:"),
        "",
        item("one step after the other, nothing overlaps; what processes tell each other but pictures takes no time;"),
        item("*select*: each GPU culls, projects and selects all objects of all GPUs, N times the measured time;",
             "*split*: `balance` for N, between the measured N by its logarithm, and `in_tile`, of all objects too;"),
        item("*own part*: `frame/streamed/exact` without the selection, by the largest share, though what its calls",
             "take at least does not become less;"),
        item(f"*draw*: {measured['triangles_drawn']:,} triangles by the largest share,",
             f"{TRIANGLES_PER_MS / 1e6:g} million a millisecond, which was not measured; a triangle outside its tile",
             "costs as much as one inside;"),
        item(f"*picture*: {PICTURE[0]} x {PICTURE[1]}, 4 bytes a pixel, to one GPU: from the others of its machine, of",
             f"{GPUS_A_MACHINE} GPUs, at {PEER_BYTES_PER_MS / 1e6:g} GB/s, from other machines at",
             f"{NETWORK_BYTES_PER_MS / 1e6:g} GB/s, which was not measured either. A display wall does without;"),
        item(f"the largest shares are those above, of plants with {per_gpu:,.0f} objects a GPU, each larger on the",
             "screen than in a plant of more. *corner*: those that the H200 found for",
             f"{measured['objects']:,} objects in all, seen from a corner."),
        "",
        words("Efficiency is the time of one GPU over that of N."),
        "",
        *predicted_table(predicted),
        "",
        words("Two limits show. An object is drawn whole in every tile that it touches: near cameras give most of the",
              f"budget to a few large objects, and with {largest:.0f} GPUs the busiest has",
              f"{share('flight', largest):.1f} times an equal share on the flight and {share('around', largest):.1f}",
              "from around. And each GPU selects and splits among all objects:",
              f"{figure(both['select'] + both['split'])} ms at N = {largest:.0f}, which grows with N while its own",
              "part does not."),
        "",
        "## The same model",
        "",
        words(f"As above, but the {measured['objects']:,} objects and {measured['budget']:,} vertices are shared by",
              "all GPUs, with the shares of *corner*, and the times of one GPU over those of N. What all do for all",
              "objects is what keeps the steps before drawing from N times the speed."),
        "",
        *fixed_table(predicted),
        "",
    ]  # fmt: skip
    return "\n".join(text)


# ---- the picture ----------------------------------------------------------------------------------------------------

COLOURS = {"grid": "#7a7a7a", "static": "#c9a227", "even": "#c8571b", "dynamic": "#1f5fa8", "ideal": "#000000",
           "around": "#1f5fa8", "flight": "#c8571b", "corner": "#2e8b57"}  # fmt: skip
WIDTH, HEIGHT, TOP, BOTTOM = 1200, 520, 110, 420


def axes(x0, x1, title, below, ticks_x, at_x, top, step, label):
    def at_y(value):
        return BOTTOM - (BOTTOM - TOP) * value / top

    parts = [
        f'<rect x="{x0}" y="{TOP}" width="{x1 - x0}" height="{BOTTOM - TOP}" fill="#fafafa" stroke="#999"/>',
        write((x0 + x1) / 2, TOP - 12, title, 16, "middle", weight="bold"),
        write((x0 + x1) / 2, BOTTOM + 42, below, 14, "middle"),
    ]
    for tick in ticks_x:
        parts.append(line(at_x(tick), TOP, at_x(tick), BOTTOM, "#ddd"))
        parts.append(write(at_x(tick), BOTTOM + 20, f"{tick:g}", 13, "middle"))
    for i in range(round(top / step) + 1):
        parts.append(line(x0, at_y(i * step), x1, at_y(i * step), "#ddd"))
        parts.append(write(x0 - 8, at_y(i * step) + 5, label(i * step), 13, "end"))
    return parts, at_y


def legend(x, names):
    parts = []
    for name, label in names:
        parts.append(line(x, HEIGHT - 22, x + 24, HEIGHT - 22, COLOURS[name], 3))
        parts.append(write(x + 30, HEIGHT - 17, label, 14))
        x += 50 + 8 * len(label)
    return parts


def curve(points, colour, width=1.6):
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def picture(tables, measured):
    frames = tables["frame"]
    event = tables["flight"][0]["frame"]
    predicted = Predicted(measured, tables["growth"])
    last = max(row["frame"] for row in frames)
    longest = max(row["ms_" + m] for row in frames for m in METHODS)
    step = next(s for s in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000) if 6 * s >= longest)
    top = step * math.ceil(longest / step)
    left, middle, right = (70, 660), 740, 1176

    def at_frame(frame):
        return left[0] + (left[1] - left[0]) * frame / max(1, last)

    parts = [
        write(left[0], 32, "Tiles on a flight, and what is left of N GPUs", 20, weight="bold"),
        write(left[0], 56, f"Left: {frames[0]['gpus']:.0f} simulated GPUs; from frame {event:.0f} on the first one is "
              f"slower by {frames[0]['slow']:g}. "
              "Right: predicted, model and budget grow with N; dots: without drawing."),
    ]  # fmt: skip
    more, at_y = axes(*left, "milliseconds of a frame", "frame", range(0, int(last) + 1, max(1, int(last + 1) // 6)),
                      at_frame, top, step, lambda v: f"{v:g}")  # fmt: skip
    parts += more
    parts.append(line(at_frame(event), TOP, at_frame(event), BOTTOM, "#888", 1.5))
    for method in METHODS:
        parts.append(curve([(at_frame(row["frame"]), at_y(row["ms_" + method])) for row in frames], COLOURS[method],
                           1 if method == "ideal" else 1.8))  # fmt: skip
    most = max(max(shares) for shares in predicted.shares.values())

    def at_gpus(gpus):
        return middle + (right - middle) * math.log2(gpus) / max(1, math.log2(most))

    ticks = [2**i for i in range(int(math.log2(most)) + 1)]
    more, at_y = axes(middle, right, "efficiency", "GPUs", ticks, at_gpus, 1.0, 0.2, lambda v: f"{100 * v:.0f} %")
    parts += more
    for place, shares in predicted.shares.items():
        points = [(at_gpus(n), at_y(predicted.efficiency(n, place))) for n in sorted(shares)]
        parts.append(curve(points, COLOURS[place], 2))
        parts += [mark("circle", at_gpus(n), at_y(predicted.efficiency(n, place, "draw") or 0.0), 4, COLOURS[place],
                       True) for n in sorted(shares)]  # fmt: skip
    parts += legend(left[0], [(m, m) for m in METHODS])
    parts += legend(middle, [(p, p) for p in predicted.shares])
    return svg_of(WIDTH, HEIGHT, parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="only tell whether both are up to date")
    parser.add_argument("--csv", type=pathlib.Path, default=DOCS / "performance" / "tiles.csv")
    parser.add_argument("--gpu", type=pathlib.Path, default=DOCS / "performance" / "h200.json")
    parser.add_argument("--table", type=pathlib.Path, default=DOCS / "performance" / "tiles.md")
    parser.add_argument("--picture", type=pathlib.Path, default=DOCS / "images" / "tiles.svg")
    options = parser.parse_args()

    tables, measured = read(options.csv), json.loads(options.gpu.read_text("utf-8"))
    stale = False
    for path, made in ((options.table, page(tables, measured)), (options.picture, picture(tables, measured))):
        if not options.check:
            path.write_text(made, "utf-8")
        elif not path.exists() or path.read_text("utf-8") != made:
            print(f"{path} is not what {options.csv} and {options.gpu} say: run scripts/tiles.py", file=sys.stderr)
            stale = True
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
