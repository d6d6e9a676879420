#!/usr/bin/env python3
"""Fills the GPU part of docs/performance.md from docs/performance/h200.json.

performance.py           writes the page
performance.py --check   writes nothing; exits with 1 where the page is not what the JSON says

The part lies between the lines <!-- gpu: begin --> and <!-- gpu: end -->. Options --page and --json name other files.
Nothing but Python's standard library is needed.
"""

import argparse
import json
import pathlib
import sys

BEGIN, END = "<!-- gpu: begin -->", "<!-- gpu: end -->"
NOTHING = "No result from a GPU has been committed yet. `scripts/gpu` measures one where there is a GPU."


def figure(value, digits=3):
    """A number with so many significant digits, no exponent, thousands grouped."""
    if value is None:
        return ""
    decimals = 0
    while decimals < 4 and abs(value) * 10**decimals < 10 ** (digits - 1):
        decimals += 1
    return f"{value:,.{decimals}f}"


def target(row):
    if "target_ms" not in row:
        return ""
    aim = f"≤ {round(row['target_ms'], 3):g}"
    if "ms" not in row:
        return aim
    return f"{aim}: met" if row["ms"] <= row["target_ms"] else f"{aim}: **missed**"


def percent(value):
    return "" if value is None else f"{100 * value:.0f} %" if value >= 0.01 else f"{100 * value:.2f} %"


def flight(result, policy):
    """The Markdown of a path: what goes over the bus in a frame, in three ways, and how fast the whole is."""

    def get(name):
        return result.get(f"path_{policy}_{name}")

    if get("serial_fps") is None:
        return []
    text = [
        "",
        f"Streaming along a flight through the plant, policy {policy}: {get('frames'):,} frames, "
        f"{get('metres_per_frame'):g} m between two, {get('vertices'):,.0f} vertices and {get('triangles'):,.0f} triangles "
        f"(6 bytes each) on average, of which {100 * get('new_vertices_share'):.1f} % and "
        f"{100 * get('new_triangles_share'):.1f} % are new ({100 * get('most_new_vertices_share'):.1f} % of the vertices "
        "at most). Milliseconds of a frame, medians:",
        "",
        "| | collect | transfer | defragment | together | MB |",
        "|---|---|---|---|---|---|",
    ]
    ways = [("packing what is new", "coherent", get("coherent_defragment_ms")), ("packing all", "full", None)]
    for title, name, defragment in ways:
        collect, transfer = get(f"{name}_collect_ms"), get(f"{name}_transfer_ms")
        cells = [title, figure(collect), figure(transfer), figure(defragment)]
        cells += [figure(collect + transfer + (defragment or 0)), figure(get(f"{name}_bytes") / 1e6)]
        text.append("| " + " | ".join(cells) + " |")
    if get("unpacked_copies") is not None:
        memory = "page-locked" if get("unpacked_page_locked") else "pageable"
        copies = f"{get('unpacked_copies'):,.0f} copies from {memory} memory"
        together = get("unpacked_transfer_ms") + get("coherent_defragment_ms")
        cells = [f"no packing, {copies}", "", figure(get("unpacked_transfer_ms")), figure(get("coherent_defragment_ms"))]
        cells += [figure(together), figure(get("coherent_bytes") / 1e6)]
        text.append("| " + " | ".join(cells) + " |")
    text += [
        "",
        f"The rest of the frame: selecting {figure(get('select_ms'))} ms, offsets to the host "
        f"{figure(get('offsets_ms'))} ms, `reform_block` and `gather_block` {figure(get('build_ms'))} ms. With "
        f"`BlockStream`, one frame after the other: {get('serial_fps'):,.0f} frames/s; with packing and copying beside "
        f"the frame before: {get('overlapped_fps'):,.0f}.",
    ]
    return text


def section(result):
    """The Markdown of one result."""
    get = result.get
    rows = result["rows"]
    measured = [row for row in rows if "ms" in row]
    compared = [row for row in rows if "equal" in row]
    differ = [row["name"] for row in compared if not row["equal"]]
    failed = [row["name"] for row in rows if "FAILED" in row.get("note", "") and row["name"] not in differ]

    text = [
        f"Made by `scripts/performance.py` from [performance/h200.json](performance/h200.json), what `scripts/gpu` "
        f"measured on {get('date')}: {get('gpu')}, driver {get('driver', 'unknown')}, CUDA "
        f"{get('toolkit')}, commit {get('commit', 'unknown')}; the host's times on {get('host_cores'):.0f} cores of "
        f"{get('processor')}."
    ]
    if "copy_gb_per_s" in result:
        text.append(
            f"A copy within the GPU's memory moved {figure(result['copy_gb_per_s'], 4)} GB/s (bytes read and bytes "
            "written) in the same run; *of copy* is how much of that a call reaches when it is charged with the least "
            "bytes, each input read once and each output written once."
        )
    if "objects" in result:
        stitched = "stitched" if get("stitched") else "unstitched"
        text.append(
            f"The model is the plant, {stitched}: {get('objects'):,} objects, {get('model_vertices'):,} vertices, "
            f"{get('model_triangles'):,} triangles."
        )
    if "triangles_drawn" in result:
        text.append(
            f"N = {get('budget'):,} vertices: of {get('objects_in_view'):,} objects in view {get('objects_drawn'):,} "
            f"are drawn, with {get('vertices_drawn'):,} vertices and {get('triangles_drawn'):,} triangles; a corner "
            f"takes {get('steps_per_corner'):.2f} collapses on average, {get('steps_longest'):,} at most."
        )
    if "occlusion_hidden" in result:
        text.append(
            f"Occlusion culling is measured from just outside a corner of the plant, at eye level: {get('occluders'):,} "
            f"occluders with {get('occluder_triangles'):,} triangles hide {get('occlusion_hidden'):,} of the "
            f"{get('occlusion_in_view'):,} objects in view on a map of 4096 by 4096; `inside` is a view from a bay in "
            "its midst."
        )
    if compared and not differ:
        text.append(f"In all {len(compared)} rows that compare them, the GPU wrote the host's bytes.")
    if differ:
        text.append("**The GPU's bytes differ from the host's in:** " + ", ".join(f"`{n}`" for n in differ) + ".")
    if failed:
        text.append("**Failed:** " + ", ".join(f"`{n}`" for n in failed) + ".")
    for step in ("tests", "sanitizer", "stopped"):
        if step in result:
            text.append(f"{step.capitalize()}: {result[step]}.")

    cores = f"{get('host_cores'):.0f} cores"
    text += [
        "",
        "Milliseconds, medians: *graph*, replayed as a CUDA graph with other data in the caches (what is no graph: its "
        "calls on a stream); *calls*, the same calls put on a stream one by one; *warm*, replayed again and again.",
        "",
        f"| call | graph | of copy | calls | warm | one core | {cores} | aim |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in measured:
        cells = [
            f"`{row['name']}`",
            figure(row["ms"]),
            percent(row.get("fraction_of_copy")),
            figure(row.get("stream_ms")),
            figure(row.get("warm_ms")),
            figure(row.get("host_1_ms")),
            figure(row.get("host_all_ms")),
            target(row),
        ]
        text.append("| " + " | ".join(cells) + " |")
    notes = [f"- `{row['name']}`: {row['note']}." for row in rows if row.get("note")]
    if notes:
        text += ["", *notes]
    for policy in ("exact", "fair"):
        text += flight(result, policy)
    return "\n".join(text)


def page_with(page, part):
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"performance.py: the page lacks {BEGIN} or {END}")
    return f"{head}{BEGIN}\n{part}\n{END}{tail}"


def main():
    docs = pathlib.Path(__file__).resolve().parent.parent / "docs"
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="only tell whether the page is up to date")
    parser.add_argument("--page", type=pathlib.Path, default=docs / "performance.md")
    parser.add_argument("--json", type=pathlib.Path, default=docs / "performance" / "h200.json")
    options = parser.parse_args()

    part = section(json.loads(options.json.read_text("utf-8"))) if options.json.exists() else NOTHING
    page = options.page.read_text("utf-8")
    filled = page_with(page, part)
    if options.check:
        if filled != page:
            print(f"{options.page} is not what {options.json} says: run scripts/performance.py", file=sys.stderr)
            return 1
        return 0
    options.page.write_text(filled, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
