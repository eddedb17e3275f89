#!/usr/bin/env python3
"""The measuring station with the shipped tool: lamps that drift, colour by a chart, a part's height, images, gauge studies.

    test_station.py PROGRAMS FOLDER
"""
import json
import re
import sys
import unittest

import numpy as np

from bench import Bench

BENCH = Bench(sys.argv[1], sys.argv[2])
CALIBRATION_BIT = 15
AIAG = {  # MSA 4th ed., chapter III B: ten parts, three appraisers, three trials
    "A": [[0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36], [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
          [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31]],
    "B": [[0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68], [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
          [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50]],
    "C": [[0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49], [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
          [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16]]}
WHITE = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).sum(axis=1)


def lab(xyz):
    """CIE 15, of the ratios to D65's white."""
    t = np.asarray(xyz, float) / WHITE
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def inspect(recordings, *more):
    done = BENCH.run("inspect", "--config", BENCH.station, "--recipe", BENCH.recipe, "--from", recordings, "--json", *more)
    return done.returncode, json.loads(done.stdout)["parts"][0]


class Lamps(unittest.TestCase):
    def drifted(self, name, drift):
        text = (BENCH.folder / "scenes/good.yaml").read_text()
        scene = BENCH.scene(name, text + f"\nlight: {{drift: {drift}, ambient: 0}}\n")
        return inspect(BENCH.simulate(scene, name, seed=501))

    def test_a_lamp_that_drifts_a_little_is_corrected(self):
        code, part = self.drifted("lamp_a_little", [0.02, -0.02])
        self.assertEqual((code, part["verdict"]), (0, "pass"), part["reasons"])
        self.assertAlmostEqual(part["lamp_drift"][0], 0.02, delta=0.003)
        self.assertAlmostEqual(part["lamp_drift"][1], -0.02, delta=0.003)

    def test_a_lamp_that_drifts_too_far_is_not_judged(self):
        code, part = self.drifted("lamp_far", [0, -0.1])
        self.assertEqual((code, part["verdict"]), (3, "not_judged"))
        self.assertTrue(part["reason_bits"] >> CALIBRATION_BIT & 1)
        self.assertRegex(" ".join(part["reasons"]), r"light 2 drifted by -(9\.|10).* %, over its limit 5 %")

    def test_nothing_is_taught_under_it(self):
        done = BENCH.run("teach", "--config", BENCH.station, "--from", BENCH.simulate(
            BENCH.scene("lamp_teach", (BENCH.folder / "scenes/good.yaml").read_text() + "\nlight: {drift: [0.2, 0], ambient: 0}\n"),
            "lamp_teach"), "--out", BENCH.folder / "drifted.recipe.yaml")
        self.assertEqual(done.returncode, 2)
        self.assertRegex(done.stderr, r"cannot teach: calibration: light 1 drifted by \+(19\.|20).* %")

    def test_the_patch_is_measured_in_the_open_nest(self):
        recordings = [BENCH.folder / "recordings" / name for name in ("dark", "white")]
        nest = BENCH.simulate(BENCH.folder / "scenes/absent.yaml", "open_nest")
        report = BENCH.json("calibrate", "--config", BENCH.station, "--from", *recordings, nest, "--out", BENCH.folder / "nest.exr")
        for light in report["monitor_patch_f"]:
            for f in light:
                self.assertAlmostEqual(f * np.pi, 0.9, delta=0.01)


class Colour(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """A camera that is not sRGB, and nobody told the station what it is."""
        text = BENCH.station.read_text()
        text = re.sub(r"(white_exposure_ms: \S+)", r"\1\n  camera_rgb: [0.72, 0.23, 0.05, 0.16, 0.74, 0.10, 0.04, 0.20, 0.76]", text)
        text = re.sub(r"colour: \S+", "colour: chart", text)
        text = re.sub(r"calibration: \S+", "calibration: colour.exr", text)
        cls.station = BENCH.folder / "colour.yaml"
        cls.station.write_text(text)
        cls.out = {}
        for scene, parts in (("dark", 1), ("white", 2), ("chart", 1)):
            cls.out[scene] = BENCH.folder / "recordings" / f"colour_{scene}"
            done = BENCH.run("simulate", "--config", cls.station, "--scene", BENCH.folder / f"scenes/{scene}.yaml", "--out",
                             cls.out[scene], "--parts", parts)
            assert done.returncode == 0, done.stderr

    def calibrate(self, *scenes, more=()):
        return BENCH.json("calibrate", "--config", self.station, "--from", *(self.out[s] for s in scenes), "--out",
                          BENCH.folder / "colour.exr", *more)

    def test_the_matrix_is_the_least_squares_one(self):
        found = self.calibrate("dark", "white", "chart")["colour"]
        self.assertEqual((found["illuminant"], found["observer_deg"], found["chart_illuminant"]), ("D65", 2, "D50"))
        rows, sides = [], []
        for patch in found["patches"]:
            xyz = np.array(patch["xyz"])
            step = 1e-5
            slope = np.column_stack([(lab(xyz + step * e) - lab(xyz - step * e)) / (2 * step) for e in np.eye(3)])
            rows.append(np.kron(slope, patch["rgb"]))  # M row by row
            sides.append(slope @ xyz)
        m = np.linalg.lstsq(np.vstack(rows), np.concatenate(sides), rcond=None)[0].reshape(3, 3)
        np.testing.assert_allclose(found["to_xyz"], m, atol=1e-6)
        self.assertLess(found["de00_mean"], 0.5)
        self.assertGreater(found["de00_max"], found["de00_mean"])

    def test_colour_is_valid_with_the_chart_and_right(self):
        albedo = np.array([0.42, 0.18, 0.09])
        scene = BENCH.scene("brown", f"target: part\nmaterials:\n  - {{name: brown, lambert: {albedo.tolist()}}}\n")
        recordings = BENCH.folder / "recordings/brown"
        BENCH.run("simulate", "--config", self.station, "--scene", scene, "--out", recordings)
        labs = {}
        for name, scenes, more in (("none", ("dark", "white"), ()), ("chart", ("dark", "white", "chart"), ()),
                                   ("root", ("dark", "white", "chart"), ("--colour-model", "root-polynomial"))):
            self.calibrate(*scenes, more=more)
            result = BENCH.json("reconstruct", "--config", self.station, "--calibration", BENCH.folder / "colour.exr", "--from", recordings,
                                "--out", BENCH.folder / "brown_out")
            cluster = result["parts"][0]["clusters"][0]
            self.assertEqual(cluster["valid"]["colour"], name != "none")
            labs[name] = np.array(cluster["lab"])
        srgb = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
        for name in ("chart", "root"):
            self.assertLess(np.linalg.norm(labs[name] - lab(srgb @ albedo)), 4, labs)


class Height(unittest.TestCase):
    def test_a_part_of_known_height_reads_as_if_it_lay_flat(self):
        """A grey 8 mm above the reference: 6 % brighter under light 2 unless the station knows."""
        flat = "target: part\nmaterials:\n  - {name: grey, lambert: [0.4, 0.4, 0.4]}\n"
        readings = {}
        for name, height, known in (("flat", 0, 0), ("told", 8, 8), ("not_told", 8, 0)):
            station = BENCH.folder / f"height_{name}.yaml"
            station.write_text(re.sub(r"part_height_mm: \S+", f"part_height_mm: {known}", BENCH.station.read_text()))
            scene = BENCH.scene(f"height_{name}", flat + f"pose: {{height_mm: {height}}}\n")
            recordings = BENCH.simulate(scene, f"height_{name}", seed=5)
            result = BENCH.json("reconstruct", "--config", station, "--from", recordings, "--out", BENCH.folder / "height_out")
            readings[name] = result["parts"][0]["clusters"][0]["lab"][0]
        self.assertLess(abs(readings["told"] - readings["flat"]), 0.25, readings)
        self.assertGreater(readings["not_told"] - readings["flat"], 0.4, readings)

    def test_a_recipe_of_another_height_is_refused(self):
        station = BENCH.folder / "height_recipe.yaml"
        station.write_text(re.sub(r"part_height_mm: \S+", "part_height_mm: 3", BENCH.station.read_text()))
        done = BENCH.run("inspect", "--config", station, "--recipe", BENCH.recipe, "--from", BENCH.folder / "recordings/good")
        self.assertEqual(done.returncode, 2)
        self.assertIn("part_height_mm 0 is another height", done.stderr)


class Images(unittest.TestCase):
    def test_images_are_written_per_recording(self):
        recordings = BENCH.simulate(BENCH.folder / "scenes/good.yaml", "images", parts=2, seed=9)
        out = BENCH.folder / "images_out"
        done = BENCH.run("inspect", "--config", BENCH.station, "--from", recordings, "--export-images", out)
        self.assertEqual(done.returncode, 3, done.stderr)  # no recipe
        for part in ("part_0001", "part_0002"):
            self.assertEqual(sorted(p.name for p in (out / part).iterdir()), ["radiance.exr", "reflectance.exr"])
            header = (out / part / "reflectance.exr").read_bytes()[:4000]
            self.assertEqual(header[:4], b"\x76\x2f\x31\x01")
            for name in (b"\0R\0", b"\0light1.variance.G\0", b"\0light2.mask\0", b"\0region\0", b"brdfgate.calibration_hash"):
                self.assertIn(name.strip(b"\0"), header)


class Studies(unittest.TestCase):
    def test_the_manuals_example(self):
        table = BENCH.folder / "aiag.csv"
        rows = [f"{part},{who},{value}" for who, trials in AIAG.items() for trial in trials for part, value in enumerate(trial)]
        table.write_text("part,operator,value\n" + "\n".join(rows) + "\n")
        done = BENCH.run("study", "grr", "--table", table, "--json", "--picture", BENCH.folder / "grr.png")
        anova = json.loads(done.stdout)
        self.assertEqual(done.returncode, 1)  # four categories
        self.assertAlmostEqual(anova["grr"], 0.302373, places=5)
        self.assertEqual((anova["ndc"], anova["trials"], len(anova["parts"])), (4, 3, 10))
        self.assertTrue((BENCH.folder / "grr.png").read_bytes().startswith(b"\x89PNG"))
        ranges = BENCH.json("study", "grr", "--table", table, "--average-range")
        self.assertAlmostEqual(ranges["grr_percent"], 26.68, delta=0.01)
        self.assertEqual(ranges["ndc"], 5)

    def test_repeats_of_one_part(self):
        recordings = BENCH.simulate(BENCH.scene("same", (BENCH.folder / "scenes/good.yaml").read_text()), "repeats", parts=4, seed=30)
        result = BENCH.json("inspect", "--config", BENCH.station, "--from", recordings, codes=(3,))
        values = [p["clusters"][0]["lab"][0] for p in result["parts"]]
        study = BENCH.json("study", "type1", "--config", BENCH.station, "--from", recordings, "--reading", "L*", "--tolerance", 50, "--reference",
                           values[0])
        np.testing.assert_allclose(study["values"], values, atol=1e-9)
        s = np.std(values, ddof=1)
        self.assertAlmostEqual(study["cg"], 0.2 * 50 / (6 * s), places=6)
        self.assertAlmostEqual(study["cgk"], (5 - abs(np.mean(values) - values[0])) / (3 * s), places=6)
        (BENCH.folder / "results.json").write_text(json.dumps(result))
        again = BENCH.json("study", "type1", "--from", BENCH.folder / "results.json", "--reading", "L*", "--tolerance", 50)
        self.assertAlmostEqual(again["cg"], study["cg"], places=9)
        self.assertNotIn("cgk", again)

    def test_what_cannot_be_studied_is_named(self):
        for arguments, what in ((("type1", "--tolerance", 1), "one source"),
                                (("type1", "--tolerance", 1, "--table", BENCH.folder / "none.csv"), "none.csv"),
                                (("grr", "--operators", BENCH.folder / "nowhere"), "holds no part")):
            done = BENCH.run("study", *arguments)
            self.assertEqual(done.returncode, 2)
            self.assertIn(what, done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
