"""tile_study and scripts/tiles.py as their users meet them, on a small plant."""

import csv
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
SCRIPT = ROOT / "scripts" / "tiles.py"
PROGRAM = os.environ.get("PGL_TILE_STUDY_PROGRAM")
SMALL = ("--objects", "1000", "--per-gpu", "100", "--gpus", "8", "--frames", "60", "--cameras", "3")


@unittest.skipUnless(PROGRAM, "no tile_study was built")
class Tiles(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.csv = pathlib.Path(cls.folder.name) / "tiles.csv"
        with cls.csv.open("w", encoding="utf-8") as file:
            subprocess.run([PROGRAM, *SMALL], stdout=file, stderr=subprocess.DEVNULL, check=True)
        with cls.csv.open(encoding="utf-8", newline="") as file:
            cls.rows = list(csv.DictReader(file))

    def of(self, table, **known):
        return [r for r in self.rows if r["table"] == table and all(r[k] == v for k, v in known.items())]

    def test_has_no_cell_outside_its_columns(self):
        self.assertTrue(all(None not in row and None not in row.values() for row in self.rows))

    def test_quality_gives_what_one_selection_gives(self):
        for row in self.of("adapt", mode="quality"):
            self.assertEqual((row["unified"], row["drawn_unified"]), (row["vertices"], row["drawn"]))

    def test_no_budget_is_passed(self):
        rows = self.of("adapt", mode="exact") + self.of("adapt", mode="fair")
        self.assertEqual(len(rows), 12)
        for row in rows:
            self.assertLessEqual(int(row["in_tiles"]), int(row["selected"]))
            self.assertLessEqual(int(row["selected"]), int(row["budget"]))

    def test_what_is_in_no_two_tiles_is_drawn_once(self):
        for row in self.of("adapt", gpus="1") + self.of("growth", gpus="1"):
            self.assertEqual(row["shared"], "0")
        for row in self.of("growth"):
            self.assertGreaterEqual(int(row["triangles_in"]), int(row["triangles"]))
            self.assertGreaterEqual(int(row["largest"]) * int(row["gpus"]), int(row["triangles_in"]))

    def test_a_slow_gpu_is_felt_and_balanced(self):
        for gpus in ("2", "4", "8"):
            def mean(mode, slow, gpus=gpus):
                (row,) = self.of("flight", gpus=gpus, mode=mode, slow=slow)
                return float(row["ms_mean"])

            self.assertEqual(mean("even", "1"), mean("ideal", "1"))
            self.assertGreater(mean("even", "4"), 1.2 * mean("even", "1"))
            self.assertLess(mean("dynamic", "4"), mean("even", "4"))

    def test_a_single_gpu_has_nothing_to_balance(self):
        self.assertEqual({row["imbalance"] for row in self.of("flight", gpus="1")}, {"0.0000"})
        self.assertEqual(len({row["ms_mean"] for row in self.of("flight", gpus="1")}), 1)

    def script(self, *more):
        page, picture = (pathlib.Path(self.folder.name) / name for name in ("tiles.md", "tiles.svg"))
        call = [sys.executable, SCRIPT, "--csv", self.csv, "--table", page, "--picture", picture, *more]
        return subprocess.run(call, text=True, capture_output=True, check=False), page

    def test_the_page_is_checked_against_the_figures(self):
        made, page = self.script()
        self.assertEqual((made.returncode, made.stderr), (0, ""))
        self.assertEqual(self.script("--check")[0].returncode, 0)
        page.write_text(page.read_text("utf-8").replace("%", "", 1), "utf-8")
        checked, _ = self.script("--check")
        self.assertEqual(checked.returncode, 1)
        self.assertIn("run scripts/tiles.py", checked.stderr)

    def test_predicts_from_what_the_gpu_was_measured_with(self):
        """A GPU that takes no time for its own work leaves what is assumed of drawing and of the picture."""
        other = json.loads((ROOT / "docs" / "performance" / "h200.json").read_text("utf-8"))
        for row in other["rows"]:
            row["ms"] = 0.0
        other["triangles_drawn"] = 5_000_000  # 10 ms
        gpu = pathlib.Path(self.folder.name) / "gpu.json"
        gpu.write_text(json.dumps(other), "utf-8")
        made, page = self.script("--gpu", gpu)
        self.assertEqual((made.returncode, made.stderr), (0, ""))
        lines = page.read_text("utf-8").splitlines()
        first, second = (next(text for text in lines if text.startswith(f"| around | {n} |")) for n in (1, 2))
        self.assertEqual(first, "| around | 1 | 0 | 0 | 0 | 10.0 | 0 | 10.0 | 100 % |  |")
        (row,) = self.of("growth", gpus="2", mode="around")
        share = 2 * int(row["largest"]) / int(row["triangles"])
        cells = [cell.strip() for cell in second.split("|")]
        self.assertAlmostEqual(float(cells[6]), 10 * share, delta=0.051)
        self.assertEqual(cells[7], "0.0425")  # half of the picture from a peer: 16.6 MB at 390 GB/s

    def test_refuses_what_it_does_not_know(self):
        for words in (("--object", "3"), ("--objects",), ("--objects", "0"), ("--gpus", "65")):
            done = subprocess.run([PROGRAM, *words], text=True, capture_output=True, check=False)
            self.assertIn(done.returncode, (1, 2))
            self.assertIn("tile_study", done.stderr)
            self.assertEqual(done.stdout, "")


if __name__ == "__main__":
    unittest.main()
