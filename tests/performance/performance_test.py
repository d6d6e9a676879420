"""scripts/performance.py, scripts/gpu, scripts/mutants and gpu_bench as their users meet them, without a GPU."""

import fnmatch
import json
import os
import pathlib
import re
import runpy
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
SAMPLE = {
    "schema": 1,
    "gpu": "Sample GPU",
    "driver": "1.2",
    "toolkit": "13.0",
    "commit": "0123abc",
    "date": "2000-01-01",
    "processor": "Sample CPU",
    "host_cores": 16,
    "copy_gb_per_s": 4000,
    "rows": [
        {"name": "copy", "ms": 2, "bytes": 8000000000, "gb_per_s": 4000, "fraction_of_copy": 1},
        {"name": "fast", "ms": 0.125, "fraction_of_copy": 0.5, "host_1_ms": 1234.5, "equal": True, "target_ms": 0.25},
        {"name": "slow", "ms": 0.5, "equal": True, "target_ms": 0.25},
        {"name": "absent", "note": "left out: no file"},
    ],
}
PAGE = "# Page\n\n<!-- gpu: begin -->\nold\n<!-- gpu: end -->\n\nmore\n"


def call(command, **more):
    return subprocess.run(command, text=True, capture_output=True, check=False, **more)


class Page(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.page = pathlib.Path(self.folder.name, "page.md")
        self.json = pathlib.Path(self.folder.name, "result.json")
        self.page.write_text(PAGE)

    def performance(self, *options):
        script = str(ROOT / "scripts" / "performance.py")
        return call([sys.executable, script, "--page", str(self.page), "--json", str(self.json), *options])

    def write(self, result):
        self.json.write_text(json.dumps(result))

    def test_is_filled_from_the_result_and_keeps_the_rest(self):
        self.write(SAMPLE)
        self.assertEqual(self.performance().returncode, 0)
        text = self.page.read_text()
        self.assertTrue(text.startswith("# Page\n\n<!-- gpu: begin -->\nMade by"))
        self.assertTrue(text.endswith("<!-- gpu: end -->\n\nmore\n"))
        self.assertNotIn("old", text)
        self.assertIn("| `fast` | 0.125 | 50 % |  |  | 1,234 |  | ≤ 0.25: met |", text)
        self.assertIn("| `slow` | 0.500 |  |  |  |  |  | ≤ 0.25: **missed** |", text)
        self.assertIn("In all 2 rows that compare them, the GPU wrote the host's bytes.", text)
        self.assertIn("- `absent`: left out: no file.", text)

    def test_says_which_bytes_differ(self):
        self.write(SAMPLE | {"rows": [{"name": "wrong", "ms": 1, "equal": False, "note": "FAILED: they differ"}]})
        self.performance()
        self.assertIn("**The GPU's bytes differ from the host's in:** `wrong`.", self.page.read_text())
        self.assertNotIn("In all", self.page.read_text())

    def test_says_what_is_hidden(self):
        hidden = {"occlusion_in_view": 718000, "occlusion_hidden": 440000, "occluders": 20, "occluder_triangles": 113280}
        self.write(SAMPLE | hidden)
        self.assertEqual(self.performance().returncode, 0)
        self.assertIn("20 occluders with 113,280 triangles hide 440,000 of the 718,000 objects", self.page.read_text())

    def test_says_what_goes_over_the_bus(self):
        names = ("frames metres_per_frame vertices triangles new_vertices_share new_triangles_share "
                 "most_new_vertices_share coherent_collect_ms full_collect_ms coherent_bytes full_bytes "
                 "coherent_transfer_ms coherent_defragment_ms full_transfer_ms unpacked_transfer_ms unpacked_copies "
                 "unpacked_page_locked select_ms offsets_ms build_ms serial_fps overlapped_fps")  # fmt: skip
        values = (60, 1, 10.5e6, 15.8e6, 0.04, 0.038, 0.1, 1.5, 20, 8.8e6, 220.8e6, 0.25, 0.125, 4, 30, 12345, 1, 0.25, 0.5,
                  0.75, 200, 300)  # fmt: skip
        figures = {f"path_exact_{name}": value for name, value in zip(names.split(), values, strict=True)}
        self.write(SAMPLE | figures)
        self.assertEqual(self.performance().returncode, 0)
        text = self.page.read_text()
        self.assertIn("of which 4.0 % and 3.8 % are new (10.0 % of the vertices at most)", text)
        self.assertIn("| packing what is new | 1.50 | 0.250 | 0.125 | 1.88 | 8.80 |", text)
        self.assertIn("| packing all | 20.0 | 4.00 |  | 24.0 | 221 |", text)
        self.assertIn("12,345 copies from page-locked memory |  | 30.0 | 0.125 | 30.1 | 8.80 |", text)
        self.assertIn("200 frames/s; with packing and copying beside the frame before: 300.", text)
        self.assertNotIn("policy fair", text)

    def test_is_checked_against_the_result(self):
        self.write(SAMPLE)
        self.assertEqual(self.performance("--check").returncode, 1)
        self.assertEqual(self.page.read_text(), PAGE)
        self.performance()
        self.assertEqual(self.performance("--check").returncode, 0)
        self.write(SAMPLE | {"gpu": "Another"})
        self.assertEqual(self.performance("--check").returncode, 1)

    def test_says_that_nothing_was_measured(self):
        self.performance()
        self.assertIn("No result from a GPU has been committed yet.", self.page.read_text())

    def test_needs_its_marks(self):
        self.page.write_text("# Page\n")
        self.assertNotEqual(self.performance().returncode, 0)


class WithoutGpu(unittest.TestCase):
    def script(self, name, *arguments, smi):
        with tempfile.TemporaryDirectory() as folder:
            fake = pathlib.Path(folder, "nvidia-smi")
            fake.write_text(smi)
            fake.chmod(0o755)
            environment = os.environ | {"PATH": folder + ":" + os.environ["PATH"]}
            return call([str(ROOT / "scripts" / name), *arguments], env=environment)

    def test_scripts_gpu_says_so_in_one_line_and_fails(self):
        for smi in ("#!/bin/sh\necho 'NVIDIA-SMI has failed'\nexit 9\n", "#!/bin/sh\nexit 0\n"):
            for steps in ([], ["bench"]):
                run = self.script("gpu", *steps, smi=smi)
                self.assertEqual(run.returncode, 1)
                self.assertEqual(run.stdout, "")
                self.assertEqual(run.stderr.count("\n"), 1)
                self.assertIn("no NVIDIA GPU here", run.stderr)

    def test_scripts_gpu_knows_its_steps(self):
        run = self.script("gpu", "tests", smi="#!/bin/sh\nexit 9\n")
        self.assertEqual(run.returncode, 2)
        self.assertIn("unknown step 'tests'", run.stderr)

    def test_scripts_mutants_says_so_in_one_line_and_fails(self):
        run = self.script("mutants", smi="#!/bin/sh\necho 'NVIDIA-SMI has failed'\nexit 9\n")
        self.assertEqual(run.returncode, 1)
        self.assertEqual(run.stdout, "")
        self.assertRegex(run.stderr, r"^mutants: (no NVIDIA GPU here|nvcc is missing); nothing was tried\n$")

    def test_scripts_mutants_knows_its_names(self):
        run = self.script("mutants", "chain", "chian", smi="#!/bin/sh\nexit 9\n")
        self.assertEqual(run.returncode, 2)
        self.assertIn("no chian;", run.stderr)

    def test_scripts_mutants_is_up_to_date(self):
        mutants = runpy.run_path(str(ROOT / "scripts" / "mutants"))["MUTANTS"]
        self.assertGreater(len(mutants), 0)
        self.assertEqual(len({mutant[0] for mutant in mutants}), len(mutants))
        for name, header, old, new, test, _ in mutants:
            self.assertTrue(old in (ROOT / "include" / "pgl" / header).read_text(), f"{name} is not in {header}")
            self.assertNotEqual(old, new, name)
            self.assertTrue((ROOT / "tests" / "twin" / f"{test}.cu").exists(), name)

    def test_scripts_gpu_sanitizes_cases_that_exist(self):
        script = (ROOT / "scripts" / "gpu").read_text()
        selected = re.findall(r'^    (\w+_twin)\*?\) echo "([^"]+)" ;;$', script, re.MULTILINE)
        self.assertGreater(len(selected), 0)
        for test, patterns in selected:
            source = (ROOT / "tests" / "twin" / f"{test}.cu").read_text()
            titles = re.findall(r"^\w*(?:TEST|PROP)\w*\(\s*(\w+),\s*(\w+)", source, re.MULTILINE)
            for pattern in patterns.split(":"):
                found = [title for title in titles if fnmatch.fnmatchcase(".".join(title), pattern)]
                self.assertTrue(found, f"{test} has no {pattern}")


@unittest.skipUnless("PGL_GPU_BENCH_PROGRAM" in os.environ, "gpu_bench is not built")
class Bench(unittest.TestCase):
    program = os.environ.get("PGL_GPU_BENCH_PROGRAM", "")

    def test_needs_a_gpu(self):
        with tempfile.TemporaryDirectory() as folder:
            json_file = pathlib.Path(folder, "gpu.json")
            environment = os.environ | {"CUDA_VISIBLE_DEVICES": ""}
            run = call([self.program, "--json", str(json_file)], env=environment)
            self.assertEqual(run.returncode, 3)
            self.assertIn("no GPU", run.stderr)
            self.assertFalse(json_file.exists())

    def test_refuses_what_it_does_not_know(self):
        for options in (["--what"], ["--objects", "many"], ["--objects"], ["--objects", "0"], ["--context", "x"]):
            self.assertEqual(call([self.program, *options]).returncode, 2)

    def test_writes_what_the_page_is_made_from(self):
        with tempfile.TemporaryDirectory() as folder:
            result, table, page = (pathlib.Path(folder, name) for name in ("gpu.json", "gpu.txt", "page.md"))
            page.write_text(PAGE)
            run = call([self.program, "--host-only", "--quick", "--objects", "300", "--budget", "20000", "--rows",
                        "cull,reform,frame/,oriented,rasterize,defragment", "--context", 'note=a "quoted" one', "--json",
                        str(result), "--table", str(table)])  # fmt: skip
            self.assertEqual(run.returncode, 0, run.stderr)
            written = json.loads(result.read_text())
            self.assertEqual(written["note"], 'a "quoted" one')
            self.assertEqual(written["objects"], 300)
            self.assertEqual(written["vertices_drawn"], 20000)
            rows = {row["name"]: row for row in written["rows"]}
            for name in ("cull_frustum", "reform/16 bit", "reform_local/16 bit", "reform/32 bit", "frame/fair"):
                self.assertGreater(rows[name]["host_1_ms"], 0, name)
                self.assertGreater(rows[name]["bytes"], 0, name)
                self.assertNotIn("ms", rows[name])
                self.assertIn(name, table.read_text())
            for name in ("oriented_boxes", "rasterize_depth/1024", "rasterize_depth/1024/inside", "rasterize_depth/4096",
                         "rasterize_depth/4096/inside", "cull_occluded/1024", "cull_occluded/4096"):  # fmt: skip
                self.assertGreater(rows[name]["host_all_ms"], 0, name)
                self.assertGreater(rows[name]["bytes"], 0, name)
            for name in ("defragment/12-byte triangles/every object", "defragment_in_place/6-byte triangles/exact",
                         "defragment_in_place/6-byte triangles/fair", "reform_block/16 bit/exact",
                         "frame/streamed/fair"):  # fmt: skip
                self.assertGreater(rows[name]["host_all_ms"], 0, name)
            self.assertGreater(written["occlusion_hidden"], 0)
            self.assertLess(written["occlusion_hidden"], written["occlusion_in_view"])
            self.assertEqual(rows["cull_frustum"]["bytes"], 300 * 25)
            self.assertNotIn("project", rows)
            script = str(ROOT / "scripts" / "performance.py")
            self.assertEqual(call([sys.executable, script, "--page", str(page), "--json", str(result)]).returncode, 0)

    def test_flies_through_the_plant(self):
        with tempfile.TemporaryDirectory() as folder:
            result = pathlib.Path(folder, "gpu.json")
            run = call([self.program, "--host-only", "--quick", "--objects", "4000", "--budget", "60000", "--rows", "path/",
                        "--json", str(result)])  # fmt: skip
            self.assertEqual(run.returncode, 0, run.stderr)
            written = json.loads(result.read_text())
            for policy in ("exact", "fair"):
                share = written[f"path_{policy}_new_vertices_share"]
                self.assertGreater(share, 0)
                self.assertLess(share, 0.5)
                self.assertGreater(written[f"path_{policy}_most_new_vertices_share"], share)
                self.assertGreater(written[f"path_{policy}_coherent_collect_ms"], 0)
                self.assertNotIn(f"path_{policy}_serial_fps", written)


if __name__ == "__main__":
    unittest.main()
