#!/usr/bin/env python3
"""Measures the viewer on one GPU and on several, and makes the page of it.

several.py --viewer PROGRAM --model FILE.pgl [--gpus N] [--frames N] [--commit ID] [--date DAY] [--only WORD...]
                       runs pgl_viewer under mpirun, writes docs/performance/several.json and the page; only: the runs
                       whose names have one of the words anew, the others stay as they are
several.py             writes docs/performance/several.md from several.json
several.py --check     writes nothing; exits with 1 where the page is not what the figures say

The model is the plant at the size of the papers' Boeing (pgl_preprocess --objects 718000 --errors -o FILE.pgl). Each run
is a flight; pictures of one GPU and of several are compared byte for byte. Nothing but Python's standard library is
needed.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import textwrap

ROOT = pathlib.Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "performance" / "several.json"
PAGE = ROOT / "docs" / "performance" / "several.md"
SELECTION = ("cull", "project", "budget", "balance", "unify")
STREAMING = ("limit", "send", "defragment")
BUILDING = ("reform", "gather", "upload")
REPEATED = ("one GPU", "equal parts", "balanced, histogram", "balanced, bisection, LBT 0.03", "measured")
SLOWED = 4  # times that the slowed GPU draws each frame


class Wrong(Exception):
    """What was measured cannot be."""


# ---- measuring ------------------------------------------------------------------------------------------------------


def runs(gpus):
    """Name, ranks and options of every run."""
    slow = ["--slow", f"{gpus - 1},{SLOWED}"]
    fair = ["--policy", "fair"]
    yield "one GPU", 1, fair
    yield "equal parts", gpus, [*fair, "--tiles", "equal"]
    yield "balanced, histogram", gpus, fair
    yield "balanced, 64 bins", gpus, [*fair, "--bins", "64"]
    yield "balanced, bisection, LBT 0.03", gpus, [*fair, "--balance", "bisection"]
    yield "measured", gpus, [*fair, "--tiles", "measured"]
    yield "slowed: equal parts", gpus, [*fair, "--tiles", "equal", *slow]
    yield "slowed: balanced", gpus, [*fair, *slow]
    yield "slowed: measured", gpus, [*fair, "--tiles", "measured", *slow]
    yield "quality: one GPU", 1, ["--lod", "error"]
    yield "quality: balanced", gpus, ["--lod", "error"]
    yield "quality: measured", gpus, ["--lod", "error", "--tiles", "measured"]
    yield "performance: one GPU", 1, [*fair, "--frame-time", "20"]
    yield "performance: equal parts", gpus, [*fair, "--frame-time", "20", "--tiles", "equal"]
    yield "performance: measured", gpus, [*fair, "--frame-time", "20", "--tiles", "measured"]
    yield "performance, slowed: measured", gpus, [*fair, "--frame-time", "20", "--tiles", "measured", *slow]


def fly(arguments, folder, ranks, options):
    """The statistics of a flight, and its last picture."""
    command = [] if ranks == 1 else ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", str(ranks)]
    command += [arguments.viewer, arguments.model, "--headless", "--backend", arguments.backend, "--fly", "--stream", "always",
                "--frames", str(arguments.frames), "--size", arguments.size, "--stats", "s.json", "--output", "p.png"]  # fmt: skip
    if "error" not in options:
        command += ["--budget", str(arguments.budget)]
    done = subprocess.run([*command, *options], cwd=folder, capture_output=True, text=True, timeout=400)
    if done.returncode != 0:
        raise Wrong(f"{' '.join(options)}: {done.stderr.strip()[:400]}")
    return json.loads((folder / "s.json").read_text()), (folder / "p.png").read_bytes()


def measure(arguments):
    rows, pictures = [], {}
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for title, ranks, options in runs(arguments.gpus):
            if arguments.only and not any(word in title for word in arguments.only):
                continue
            # The frame's time is also that of a busy machine: of three flights the middle one.
            flights = [fly(arguments, folder, ranks, options) for _ in range(3 if title in REPEATED else 1)]
            stats, picture = sorted(flights, key=lambda flight: flight[0]["mean_ms"]["frame"])[len(flights) // 2]
            if any(other[1] != picture for other in flights):
                raise Wrong(f"{title}: not the same picture every time")
            each = stats.get("ranks", [stats])
            row = {"name": title, "ranks": ranks, "options": " ".join(options), "pictures": stats.get("pictures", ""),
                   "imbalance": stats.get("imbalance", {}), "gpu": stats["backend"]["gpu"],
                   "interop": stats["backend"]["interop"],
                   "each": [{"ms": r["mean_ms"], "triangles": r["drawn"]["triangles"], "vertices": r["drawn"]["vertices"],
                             "budget": r["budget"], "gpu": r["backend"]["gpu"], "weight": r.get("weight", 0), "tile": r.get("tile", []),
                             "sent": sum(f["bytes"] for f in r["stream"]["sent"][1:]) // max(1, len(r["stream"]["sent"]) - 1)}
                            for r in each]}  # fmt: skip
            kind = "error" if "error" in options else "time" if "--frame-time" in options else "budget"
            if kind != "time":
                row["same_picture"] = pictures.setdefault(kind, picture) == picture
            rows.append(row)
            frame = max(r["mean_ms"]["frame"] for r in each)
            print(f"{title:32} {frame:9.3f} ms  {row['imbalance']}  same: {row.get('same_picture')}  "
                  f"{[{k: round(v, 3) for k, v in r['mean_ms'].items() if v} for r in each]}", flush=True)  # fmt: skip
    return {"commit": arguments.commit, "date": arguments.date, "frames": arguments.frames, "budget": arguments.budget,
            "size": arguments.size, "gpus": arguments.gpus, "objects": stats["objects"],
            "triangles": stats["model"]["triangles"], "runs": rows}  # fmt: skip


# ---- the page -------------------------------------------------------------------------------------------------------


def work(row, names):
    """Of the rank that takes longest: the sum of the steps' means."""
    return max(sum(each["ms"].get(name, 0.0) for name in names) for each in row["each"])


def frame(row):
    return max(each["ms"]["frame"] for each in row["each"])


def filled(text):
    return textwrap.fill(" ".join(text.split()), 120)


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def step_table(chosen, base):
    head = ["", "selection", "streaming", "building", "drawing", "pictures", "frame, ms", "frames/s", "times",
            "imbalance, mean", "worst", "same picture"]  # fmt: skip
    rows = []
    for row in chosen:
        imbalance = row["imbalance"]
        cells = [row["name"]]
        cells += [f"{work(row, names):.2f}" for names in (SELECTION, STREAMING, BUILDING, ("draw",), ("pictures",))]
        cells += [f"{frame(row):.2f}", f"{1000 / frame(row):.1f}", f"{frame(base) / frame(row):.2f}"]
        cells += [f"{100 * imbalance[key]:.1f} %" if imbalance else "" for key in ("mean", "worst")]
        cells.append({True: "yes", False: "**NO**", None: ""}[row.get("same_picture")])
        rows.append(cells)
    return table(head, rows)


def page(figures):
    named = {row["name"]: row for row in figures["runs"]}
    one, balanced = named["one GPU"], named["balanced, histogram"]
    lod = (*SELECTION, *STREAMING, *BUILDING)
    ratio = work(one, lod) / work(balanced, lod)
    equal = named["equal parts"]
    parts = [
        "<!-- made by scripts/several.py from several.json -->",
        "# Several GPUs, one picture",
        filled(f"""A flight of {figures['frames']} frames through the plant of {figures['objects']:,} objects and
        {figures['triangles']:,} triangles, N = {figures['budget']:,} vertices, {figures['size']} pixels, every frame
        streamed, drawn with OpenGL. {figures['gpus']} x {one['gpu'].split(',')[0]}, commit {figures['commit']}, {figures['date']}."""),
        "    pgl_preprocess --objects 718000 --errors -o plant.pgl\n"
        f"    scripts/several.py --viewer pgl_viewer --model plant.pgl --gpus {figures['gpus']}",
        filled("""Milliseconds are means of all frames but the first, which sends everything, of the rank that took
        longest; *frame* includes waiting, and checking what is read of the file, which has no column; *times*: frames a
        second over those of the first row. Selection: culling, projection, budget, and with several ranks tiles
        and who is in them. Streaming: packing and sending what is new, defragmenting. Building: reform, gather,
        OpenGL's buffers. Pictures: bringing the tiles together, and waiting for the others. *Imbalance* is what the
        largest share of the triangles has above the mean. The runs of the first table, but for
        64 bins, are each the middle one of three flights. *Same picture*: the last one, byte for byte, as that of one
        GPU."""),
        "## One GPU, equal parts, balanced ([Peng13] Table 5.1)",
        step_table([named[n] for n in ("one GPU", "equal parts", "balanced, histogram", "balanced, 64 bins",
                                       "balanced, bisection, LBT 0.03", "measured")], one),  # fmt: skip
        filled(f"""Balanced against equal parts: {frame(equal) / frame(balanced):.2f} times as many frames, against one GPU
        {frame(one) / frame(balanced):.2f} times (the paper: 1.14 and 1.37). Selection, streaming and building, which pgl
        does: {work(one, lod):.2f} ms on one GPU, {work(balanced, lod):.2f} ms on {figures['gpus']}, {ratio:.2f} times as fast
        (aim: 1.8). Bytes sent in a frame: {one['each'][0]['sent']:,} on one GPU,
        {' and '.join(f"{each['sent']:,}" for each in balanced['each'])} on {figures['gpus']}."""),
        f"## One GPU slowed: it draws every frame {SLOWED} times ([NC07] Table 2)",
        step_table([named[n] for n in ("slowed: equal parts", "slowed: balanced", "slowed: measured")],
                   named["slowed: equal parts"]),  # fmt: skip
        "## Quality: an error of one pixel at most",
        step_table([named[n] for n in ("quality: one GPU", "quality: balanced", "quality: measured")],
                   named["quality: one GPU"]),  # fmt: skip
        "## Performance: 20 ms a frame, each GPU with a budget of its own",
        table(["", "frame, ms", "budgets at the end", "vertices drawn", "weights"],
              [[row["name"], f"{frame(row):.2f}"] +
               [" / ".join(f"{each[key]:,}" for each in row["each"]) for key in ("budget", "vertices")] +
               [" / ".join(f"{each['weight'] / 2**20:.2f}" for each in row["each"]) if row["ranks"] > 1 else ""]
               for row in figures["runs"] if row["name"].startswith("performance")]),  # fmt: skip
    ]
    return "\n\n".join(parts) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--viewer", type=os.path.abspath)
    parser.add_argument("--model", type=os.path.abspath)
    parser.add_argument("--backend", default="cuda")
    parser.add_argument("--gpus", type=int, default=2)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--budget", type=int, default=10_500_000)
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--commit", default="")
    parser.add_argument("--date", default="")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--figures", type=pathlib.Path, default=FIGURES)
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    try:
        if arguments.viewer:
            figures = measure(arguments)
            if any(row.get("same_picture") is False for row in figures["runs"]):
                print("several.py: pictures differ", file=sys.stderr)
            if arguments.only and arguments.figures.exists():
                again = {row["name"]: row for row in figures["runs"]}
                figures["runs"] = [again.get(row["name"], row) for row in json.loads(arguments.figures.read_text())["runs"]]
            arguments.figures.write_text(json.dumps(figures, indent=1) + "\n")
        if arguments.figures != FIGURES:
            return 0
        text = page(json.loads(FIGURES.read_text()))
    except (OSError, Wrong, subprocess.TimeoutExpired, KeyError) as error:
        print(f"several.py: {type(error).__name__}: {error}", file=sys.stderr)
        return 1
    if arguments.check:
        if not PAGE.exists() or PAGE.read_text() != text:
            print("several.py: docs/performance/several.md is not what several.json says", file=sys.stderr)
            return 1
        return 0
    PAGE.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
