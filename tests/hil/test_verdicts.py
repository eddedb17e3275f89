#!/usr/bin/env python3
"""Parts in, verdicts out: the shipped tool on simulated recordings.    test_verdicts.py PROGRAMS FOLDER"""
import json
import math
import re
import sys
import unittest

from bench import Bench

BITS = {"t2": 0, "spe": 1, "local_defect": 2, "missing_cluster": 3, "unknown_region": 4, "colour": 5, "gloss": 6, "tilt": 7, "ambient": 8,
        "clipped": 9, "coverage": 10, "part_absent": 13, "pose_or_face": 14, "calibration_or_recipe": 15}
EXIT = {"pass": 0, "reject": 1, "not_judged": 3}
BENCH = Bench(sys.argv[1], sys.argv[2])


def inspect(recordings, *more):
    done = BENCH.run("inspect", "--config", BENCH.station, "--from", recordings, "--json", *more)
    return done.returncode, json.loads(done.stdout)["parts"]


class Verdicts(unittest.TestCase):
    def judged(self, scene, verdict, any_of, name=None):
        recordings = BENCH.simulate(BENCH.folder / "scenes" / f"{scene}.yaml", name or scene, seed=900)
        code, parts = inspect(recordings, "--recipe", BENCH.recipe)
        part = parts[0]
        self.assertEqual(part["verdict"], verdict, part["reasons"])
        self.assertEqual(code, EXIT[verdict])
        if any_of:
            self.assertTrue(any(part["reason_bits"] >> BITS[bit] & 1 for bit in any_of), part["reasons"])
        else:
            self.assertEqual(part["reason_bits"], 0)
        return part

    def test_fresh_good_parts_pass(self):
        recordings = BENCH.simulate(BENCH.folder / "scenes/good.yaml", "fresh", parts=5, seed=501)
        code, parts = inspect(recordings, "--recipe", BENCH.recipe)
        self.assertEqual([p["verdict"] for p in parts], ["pass"] * 5, [p["reasons"] for p in parts])
        self.assertEqual(code, 0)

    def posed(self, name, pose):
        text = (BENCH.folder / "scenes/good.yaml").read_text()
        BENCH.scene(name, text.replace("jitter: {shift_mm: 0.3, rotation_deg: 0.2}", "pose: " + pose))
        return name

    def test_a_good_part_shifted_and_turned_within_range_passes(self):
        part = self.judged(self.posed("moved", "{shift_mm: [3, -2.5], rotation_deg: 4}"), "pass", [])
        self.assertAlmostEqual(part["shift_mm"][0], 3, delta=0.4)
        self.assertAlmostEqual(part["shift_mm"][1], -2.5, delta=0.4)
        self.assertAlmostEqual(part["rotation_deg"], 4, delta=0.4)

    def test_a_tilt_is_not_told_as_a_rotation(self):
        told = []
        for tilt in (-0.6, 0.6):
            scene = self.posed(f"leaning_{tilt}", f"{{rotation_deg: 2, tilt_deg: [{tilt}, 0]}}")
            recordings = BENCH.simulate(BENCH.folder / "scenes" / f"{scene}.yaml", scene, seed=900)
            part = inspect(recordings, "--recipe", BENCH.recipe)[1][0]
            self.assertAlmostEqual(part["tilt_deg"][0], tilt, delta=0.2)
            told.append(part["rotation_deg"])
        # By the plane alone they differ by 0.7 of the tilts' difference: 0.8 degrees.
        self.assertAlmostEqual(told[0], told[1], delta=0.2, msg=told)
        self.assertAlmostEqual(sum(told) / 2, 2, delta=0.3)

    def test_a_part_too_far_from_its_place_is_not_judged(self):
        part = self.judged(self.posed("far", "{shift_mm: [6.5, 0]}"), "not_judged", ["pose_or_face"])
        self.assertAlmostEqual(part["shift_mm"][0], 6.5, delta=0.5)
        self.judged(self.posed("turned", "{rotation_deg: -7}"), "not_judged", ["pose_or_face"])

    def test_a_part_tilted_too_far_is_not_judged(self):
        self.judged(self.posed("tilted", "{tilt_deg: [2.2, 0]}"), "not_judged", ["tilt"])

    def test_a_rougher_body_is_rejected(self):
        self.judged("bad_gloss", "reject", ["t2", "spe", "gloss"])

    def test_another_hue_is_rejected(self):
        self.judged("bad_colour", "reject", ["colour", "t2"])

    def test_a_stain_is_rejected_and_found_in_its_place(self):
        part = self.judged("stain", "reject", ["local_defect", "unknown_region"])
        self.assertGreaterEqual(len(part["defects"]), 1)
        # On a saturated red a stain darkens one channel alone: either name is right.
        self.assertIn(part["defects"][0]["kind"], ("darker", "colour"))
        self.assertAlmostEqual(part["defects"][0]["size_mm"], 6, delta=1)

    def test_the_wrong_face_is_not_passed(self):
        self.judged("upside_down", "not_judged", ["pose_or_face"])

    def test_an_absent_part_is_not_judged(self):
        self.judged("absent", "not_judged", ["part_absent"])

    def test_ambient_light_beyond_the_limit_is_not_judged(self):
        text = (BENCH.folder / "scenes/good.yaml").read_text()
        BENCH.scene("bright_room", text + "\nlight: {drift: [0, 0], ambient: 0.2}\n")
        self.judged("bright_room", "not_judged", ["ambient"])

    def test_a_saturated_bracket_is_not_judged(self):
        station = BENCH.folder / "overexposed.yaml"
        station.write_text(re.sub(r"bracket_ms: \[[^]]*\]", "bracket_ms: [300, 600]",
                                  BENCH.station.read_text()).replace("frame_timeout_ms: 1000", "frame_timeout_ms: 2000"))
        out = BENCH.folder / "recordings/overexposed"
        BENCH.run("simulate", "--config", station, "--scene", BENCH.folder / "scenes/good.yaml", "--out", out)
        code, parts = inspect(out, "--recipe", BENCH.recipe)
        self.assertEqual((code, parts[0]["verdict"]), (3, "not_judged"))
        self.assertTrue(parts[0]["reason_bits"] >> BITS["clipped"] & 1, parts[0]["reasons"])

    def test_without_a_recipe_weights_are_valid_and_nothing_is_judged(self):
        code, parts = inspect(BENCH.simulate(BENCH.folder / "scenes/good.yaml", "no_recipe", seed=7))
        self.assertEqual((code, parts[0]["verdict"]), (3, "not_judged"))
        self.assertEqual(parts[0]["reason_bits"], 1 << BITS["calibration_or_recipe"])
        self.assertTrue(parts[0]["clusters"][0]["valid"]["weights"])
        self.assertTrue(any(w != 0 for w in parts[0]["clusters"][0]["weights"][0]))

    def test_several_parts_exit_with_the_worst(self):
        good = BENCH.simulate(BENCH.folder / "scenes/good.yaml", "one_good", seed=11)
        absent = BENCH.simulate(BENCH.folder / "scenes/absent.yaml", "one_absent", seed=11)
        bad = BENCH.simulate(BENCH.folder / "scenes/bad_colour.yaml", "one_bad", seed=11)
        run = lambda *d: BENCH.run("inspect", "--config", BENCH.station, "--recipe", BENCH.recipe, "--from", *d).returncode
        self.assertEqual(run(good), 0)
        self.assertEqual(run(good, absent), 3)
        self.assertEqual(run(good, absent, bad), 1)


class Reconstruction(unittest.TestCase):
    def test_a_lambertian_part_comes_back_with_its_albedo(self):
        scene = BENCH.scene("grey", "target: part\nmaterials:\n  - {name: grey, lambert: [0.2, 0.4, 0.6]}\n")
        recordings = BENCH.simulate(scene, "grey", seed=3)
        out = BENCH.folder / "grey_out"
        result = BENCH.json("reconstruct", "--config", BENCH.station, "--from", recordings, "--out", out,
                            "--sufficient-model")
        clusters = result["parts"][0]["clusters"]
        self.assertEqual(result["parts"][0]["verdict"], "none")
        self.assertEqual(len(clusters), 1)
        model = clusters[0]["sufficient_model"]
        self.assertEqual((model["kind"], model["components"], model["parameters"]), ("lambert", 0, 3))
        same = BENCH.json("compare", out / "cluster_0.binary", out / "cluster_0.binary")
        self.assertEqual((same["mapped_rms"], same["missing_cells"]), (0, 0))
        # L* of the reconstruction at 45:0 against that of the albedo itself (CIE 15).
        luminance = 0.2126 * 0.2 + 0.7152 * 0.4 + 0.0722 * 0.6
        self.assertAlmostEqual(clusters[0]["lab"][0], 116 * luminance ** (1 / 3) - 16, delta=3)

    def test_results_have_the_published_schema(self):
        recordings = BENCH.simulate(BENCH.folder / "scenes/good.yaml", "schema", seed=4)
        out = BENCH.folder / "schema_out"
        result = BENCH.json("reconstruct", "--config", BENCH.station, "--from", recordings, "--out", out, "--method", "ridge")
        self.assertEqual(result["schema"], "brdfgate.result/1")
        cluster = result["parts"][0]["clusters"][0]
        for key in ("index name pixels bins area_share coverage valid method components weights weight_sigmas t2 t2_limit spe "
                    "spe_limit residual_rms gloss_gu lab delta_e00 brdf").split():
            self.assertIn(key, cluster)
        self.assertNotIn("sufficient_model", cluster)  # costs time: only where asked for
        self.assertEqual([len(c) for c in cluster["weights"]], [cluster["components"]] * 3)
        self.assertTrue(all(math.isfinite(w) for channel in cluster["weights"] for w in channel))
        self.assertTrue((out / cluster["brdf"]).is_file() and (out / "result.json").is_file())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
