"""scripts/streaming.py as its users meet it, with a pgl_viewer of the test's own that keeps or breaks its promises."""

import csv
import pathlib
import runpy
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
SCRIPT = ROOT / "scripts" / "streaming.py"
sys.dont_write_bytecode = True
sys.path.insert(0, str(SCRIPT.parent))
STREAMING = runpy.run_path(str(SCRIPT))

# A budget of n vertices takes 20 n bytes, and the picture is as bright as what was sent. {wrong} names a promise to
# break.
VIEWER = '''#!{python}
import json, struct, sys, zlib
wrong = "{wrong}"
values = dict(zip(sys.argv, sys.argv[1:]))
budget = 4000000 if values["--budget"] == "all" else int(values["--budget"])
frames, whole = int(values["--frames"]), 20 * budget
cap = int(values.get("--transfer", whole))
if wrong == "fails": sys.exit("pgl_viewer: no OpenGL")
sent, total, wanted = [], 0, whole
for frame in range(frames):
    part = min(cap, wanted - total)
    if wrong == "cap" and "--transfer" in values and frame == 1: part += 1
    if wrong == "stuck" and frame == 1: cap = part = 0
    if wrong == "slow" and "--transfer" in values and frame == 0: part //= 2
    total += part
    sent.append(dict(vertices=0, triangles=0, bytes=part, missing_bytes=max(0, wanted - total)))
    if "--orbit" in sys.argv: wanted += 1000000
if wrong == "twice" and "--transfer" in values and frames > 60: sent[-1]["bytes"] += 1
level = 200 * min(total, whole) // 80000000
rows = [bytes([0]) + bytes([level] * 24)] * 4
def chunk(kind, body): return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
with open(values["--output"], "wb") as file:
    file.write(b"\\x89PNG\\r\\n\\x1a\\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 8, 4, 8, 2, 0, 0, 0))
               + chunk(b"IDAT", zlib.compress(b"".join(rows))) + chunk(b"IEND", b""))
checksum = "x" if wrong == "bytes" and "--transfer" in values else "y"
json.dump(dict(objects=7, model=dict(vertices=1, triangles=2), gl=dict(renderer="r", version="v", samples=4),
               drawn=dict(objects=3, vertices=budget, triangles=total // 20, checksum=checksum),
               stream=dict(sent=sent)), open(values["--stats"], "w"))
'''


def png_of(rows, filters):
    """The picture with row y filtered as filters[y] says."""

    def paeth(a, b, c):
        p = a + b - c
        return min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]

    data, above = b"", bytes(len(rows[0]))
    for row, kind in zip(rows, filters, strict=True):
        left, corner = bytes(3) + row[:-3], bytes(3) + above[:-3]
        guess = {0: lambda a, b, c: 0, 1: lambda a, b, c: a, 2: lambda a, b, c: b, 3: lambda a, b, c: (a + b) // 2,
                 4: paeth}[kind]  # fmt: skip
        around = zip(row, left, above, corner, strict=True)
        data += bytes([kind, *((v - guess(a, b, c)) % 256 for v, a, b, c in around)])
        above = row

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    packed = zlib.compress(data)
    half = len(packed) // 2
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", len(rows[0]) // 3, len(rows), 8, 2, 0, 0, 0))
    return (b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", packed[:half]) + chunk(b"IDAT", packed[half:])
            + chunk(b"IEND", b""))  # fmt: skip


class Pictures(unittest.TestCase):
    def test_are_read_whatever_filter_a_row_has(self):
        state, rows = 1, []
        for y in range(25):
            row = bytearray()
            for _ in range(3 * 17):
                state = state * 1103515245 + 12345 & 0x7FFFFFFF
                row.append(state >> 16 & (255 if y % 2 else 7))  # small ones: guesses that are as good
            rows.append(bytes(row))
        filters = [a for a in range(5) for _ in range(5)]
        filters = [filters[(7 * y) % 25] for y in range(25)]
        self.assertEqual(set(filters), set(range(5)))
        self.assertEqual(STREAMING["rows_of"](png_of(rows, filters)), (17, rows))

    def test_of_another_kind_are_refused(self):
        good = png_of([bytes(6)], [0])
        for bad in (b"GIF89a" + good, good.replace(b"\x08\x02\x00", b"\x08\x06\x00", 1)):
            with self.assertRaises(STREAMING["Wrong"]):
                STREAMING["rows_of"](bad)

    def test_differ_by_the_root_of_the_mean_square_and_by_pixels(self):
        one, other = (2, [bytes(6), bytes(6)]), (2, [bytes((9, 0, 0, 8, 8, 8)), bytes(6)])
        rms, differ = STREAMING["difference"](one, other)
        self.assertAlmostEqual(rms, ((81 + 3 * 64) / 12) ** 0.5)
        self.assertEqual(differ, 25)
        self.assertEqual(STREAMING["difference"](other, one), (rms, differ))
        self.assertEqual(STREAMING["difference"](one, one), (0, 0))
        with self.assertRaises(STREAMING["Wrong"]):
            STREAMING["difference"](one, (2, [bytes(6)]))


class Study(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.csv, self.page, self.svg = (self.folder / f"streaming.{end}" for end in ("csv", "md", "svg"))

    def study(self, *options):
        call = [sys.executable, SCRIPT, "--csv", self.csv, "--table", self.page, "--picture", self.svg, *options]
        return subprocess.run(call, text=True, capture_output=True, check=False)

    def measure(self, wrong=""):
        viewer = self.folder / "viewer"
        viewer.write_text(VIEWER.format(python=sys.executable, wrong=wrong))
        viewer.chmod(0o755)
        return self.study("--viewer", viewer, "--model", "plant.pgl")

    def test_measures_and_its_page_is_checked_against_the_figures(self):
        run = self.measure()
        self.assertEqual(run.returncode, 0, run.stderr)
        rows = list(csv.DictReader(t for t in self.csv.read_text().splitlines() if t[0] != "#"))
        teleport = [r for r in rows if r["table"] == "teleport"]
        self.assertTrue(all(r["least_frames"] == r["complete"] == r["share"] for r in teleport))
        self.assertTrue(all((r["frame"] == r["complete"]) == (float(r["rms"]) == 0) for r in teleport))
        eighth = next(r for r in teleport if r["budget"] == "1000000" and r["share"] == "16" and r["frame"] == "8")
        self.assertEqual((eighth["bytes"], eighth["missing_bytes"], eighth["cap"]), ("10000000", "10000000", "1250000"))
        self.assertEqual((float(eighth["rms"]), float(eighth["differ"])), (25, 100))
        moving = [r for r in rows if r["table"] == "moving"]
        self.assertEqual([r["missing_bytes"] for r in moving],
                         [str(max(0, 6000000 + 29 * 1000000 - 30 * int(r["cap"] or 6000000))) for r in moving])
        page = self.page.read_text()
        self.assertRegex(page, r"none\sof\sthese\s24\stook\smore\sthan\s0\smore")
        self.assertIn("| inside | 1,000,000 | 19,531 | 1/16 | 1,221 | 16 | 16 |", page)
        self.assertEqual(self.study("--check").returncode, 0)
        for path in (self.page, self.svg):
            text = path.read_text()
            path.write_text(text.replace("N", "M", 1))
            self.assertEqual(self.study("--check").returncode, 1)
            path.write_text(text)
        self.csv.write_text(self.csv.read_text().replace("10000000,10000000", "10000000,10000001"))
        self.assertEqual(self.study("--check").returncode, 0)  # no page says this one
        self.csv.write_text(self.csv.read_text().replace(",1250000,16,16,1,", ",1250000,16,17,1,"))
        self.assertEqual(self.study("--check").returncode, 1)
        self.csv.write_text(self.csv.read_text().replace("25.0000", "26.0000"))
        self.assertEqual(self.study("--check").returncode, 1)

    def test_counts_frames_that_a_cap_could_do_without(self):
        self.assertEqual(self.measure("slow").returncode, 0)
        self.assertRegex(self.page.read_text(), r"none\sof\sthese\s24\stook\smore\sthan\s1\smore")

    def test_stops_where_a_promise_is_broken(self):
        for wrong, words in (("cap", "more than its cap"), ("bytes", "does not come to the frame without a cap"),
                             ("twice", "sends something twice"), ("stuck", "less than a single step"),
                             ("fails", "no OpenGL")):  # fmt: skip
            run = self.measure(wrong)
            self.assertEqual(run.returncode, 1, wrong)
            self.assertIn(words, run.stderr.splitlines()[-1])
            self.assertEqual(list(self.folder.glob("streaming.*")), [], wrong)

    def test_needs_a_viewer_and_a_model(self):
        self.assertEqual(self.study("--viewer", "nowhere").returncode, 2)
        run = self.study("--viewer", self.folder / "nowhere", "--model", "plant.pgl")
        self.assertEqual(run.returncode, 1)
        self.assertRegex(run.stderr, r"^streaming.py: \S+nowhere: No such file or directory\n$")


if __name__ == "__main__":
    unittest.main()
