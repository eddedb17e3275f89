#!/usr/bin/env python3
"""A recipe's rules through the shipped commands: taught, changed, judged, refused.    test_rules.py PROGRAMS FOLDER"""
import json
import shutil
import sys
import unittest

from bench import ROOT, Bench, Refusals

BENCH = Bench(sys.argv[1], sys.argv[2])
EXAMPLE = ROOT / "config/rules/good.rules.yaml"
WORK = BENCH.folder / "rules"
EXIT = {"pass": 0, "reject": 1, "not_judged": 3}
COVERAGE, COLOUR, GLOSS, LOCAL_DEFECT, TILT = 1 << 10, 1 << 5, 1 << 6, 1 << 2, 1 << 7


def rules_file(name, *rules, guard=1.65):
    file = WORK / f"{name}.rules.yaml"
    lines = "".join(f"  - {{{rule}}}\n" for rule in rules) if rules else ""
    file.write_text(f"schema: brdfgate.rules/1\nguard: {guard}\nrules:{' []' if not rules else ''}\n{lines}")
    return file


def ruled(name, *rules, guard=1.65):
    """The taught recipe with other rules."""
    out = WORK / f"{name}.recipe.yaml"
    BENCH.json("teach", "--rules", rules_file(name, *rules, guard=guard), "--recipe", BENCH.recipe, "--out", out)
    return out


class Rules(Refusals):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        WORK.mkdir()
        cls.parts = {scene: BENCH.simulate(BENCH.folder / f"scenes/{scene}.yaml", f"rules_{scene}", seed=501)
                     for scene in ("good", "bad_colour", "bad_gloss", "stain")}

    def judged(self, scene, recipe, verdict, bits=None):
        done = BENCH.run("inspect", "--config", BENCH.station, "--from", self.parts[scene], "--recipe", recipe, "--json")
        self.assertIn(done.returncode, EXIT.values(), done.stderr)
        part = json.loads(done.stdout)["parts"][0]
        self.assertEqual((part["verdict"], done.returncode), (verdict, EXIT[verdict]), part["reasons"])
        if bits is not None:
            self.assertEqual(part["reason_bits"], bits, part["reasons"])
        return part

    def refused(self, says, *arguments):
        done = BENCH.run(*arguments)
        self.assert_refused(done, says)

    def test_the_manuals_example_passes_good_parts_and_rejects_bad_ones(self):
        recipe = WORK / "example.recipe.yaml"
        taught = BENCH.json("teach", "--rules", EXAMPLE, "--recipe", BENCH.recipe, "--out", recipe)
        self.assertEqual(len(taught["rules"]), 7)
        part = self.judged("good", recipe, "pass", 0)
        outcomes = part["rules"]
        # delta_e00 of both clusters, gloss and area of one each, four of the part.
        self.assertEqual([(o["reading"], o["cluster"]) for o in outcomes],
                         [("delta_e00", "body"), ("gloss_60_gu", "body"), ("delta_e00", "region 1"), ("area_share", "region 1"),
                          ("unknown_share", None), ("defects", None), ("defect_size_mm", None), ("tilt_deg", None)])
        self.assertTrue(all(o["outcome"] == "pass" and o["reason"] is None for o in outcomes), outcomes)
        gloss = outcomes[1]
        self.assertTrue(gloss["measured"] and gloss["sigma"] > 0 and gloss["guard"] == 1.65)
        self.assertAlmostEqual(gloss["high"] - gloss["low"], 0.5, delta=1e-9)
        self.assertAlmostEqual((gloss["high"] + gloss["low"]) / 2, gloss["taught"], delta=1e-9)
        self.judged("bad_colour", recipe, "reject")
        self.judged("stain", recipe, "reject")
        gloss = [o for o in self.judged("bad_gloss", recipe, "reject")["rules"] if o["reading"] == "gloss_60_gu"][0]
        self.assertEqual(gloss["outcome"], "reject")

    def test_taught_with_rules_or_given_them_afterwards_is_the_same(self):
        good = BENCH.folder / "recordings/good"
        both = WORK / "taught.recipe.yaml"
        BENCH.json("teach", "--config", BENCH.station, "--from", good, "--rules", EXAMPLE, "--out", both, "--name", "good part")
        changed = WORK / "changed.recipe.yaml"
        BENCH.json("teach", "--rules", EXAMPLE, "--recipe", BENCH.recipe, "--out", changed)
        text = lambda file: [line for line in file.read_text().splitlines() if not line.startswith("created:")]
        self.assertEqual(text(both), text(changed))
        # In place, and taken away again: the recipe as it was.
        BENCH.json("teach", "--rules", rules_file("none"), "--recipe", changed, "--out", changed)
        self.assertEqual(changed.read_text(), BENCH.recipe.read_text())
        renamed = BENCH.json("teach", "--rules", EXAMPLE, "--recipe", BENCH.recipe, "--out", changed, "--name", "strict", "--id", 9)
        self.assertEqual((renamed["name"], renamed["id"]), ("strict", 9))

    def test_a_reading_beyond_its_rule_is_rejected_under_its_bit(self):
        for name, rule, bit, says in (
            ("colour", "reading: a_star, cluster: body, high: 10, guard: 0", COLOUR, "a_star is"),
            ("gloss", "reading: gloss_60_gu, cluster: region 1, high: 3", GLOSS, "cluster 'region 1': gloss_60_gu is"),
            ("area", "reading: area_share, cluster: 1, low: 0.5", 1 << 3, "under its limit 0.5"),
            ("residual", "reading: residual_rms, high: 0", 1 << 1, "residual_rms is"),
            ("flop", "reading: flop_index, cluster: body, low: 900", COLOUR, "flop_index is"),
        ):
            with self.subTest(name):
                part = self.judged("good", ruled(name, rule), "reject", bit)
                self.assertIn(says, " ".join(part["reasons"]))
                self.assertIn(" by ", part["reasons"][0])

    def test_a_part_tilted_beyond_its_rule_is_not_judged(self):
        self.judged("good", ruled("tilt", "reading: tilt_deg, high: 0"), "not_judged")

    def test_too_near_a_limit_is_neither_pass_nor_reject(self):
        taught = self.judged("good", ruled("loose", "reading: gloss_60_gu, cluster: body, high: 100"), "pass", 0)
        gloss = taught["rules"][0]
        self.assertGreater(gloss["sigma"], 0)
        near = gloss["value"] + 0.5 * gloss["sigma"]
        rule = f"reading: gloss_60_gu, cluster: body, high: {near:.6f}"
        part = self.judged("good", ruled("near", rule), "not_judged", COVERAGE)
        self.assertIn("too near to tell", part["reasons"][0])
        self.judged("good", ruled("near_unguarded", rule, guard=0), "pass", 0)
        self.judged("good", ruled("near_own_guard", rule + ", guard: 0.3"), "pass", 0)

    def test_an_extrapolated_reading_is_judged_unless_its_rule_demands_a_measured_one(self):
        part = self.judged("good", ruled("extrapolated", "reading: gloss_20_gu, high: 2000, guard: 0"), "pass", 0)
        self.assertEqual([o["measured"] for o in part["rules"]], [False, False])
        self.refused(["measured.rules.yaml:4:", "(rules[0].measured)", "gloss_20_gu", "this rig does not look"], "teach", "--rules",
                     rules_file("measured", "reading: gloss_20_gu, high: 2000, measured: true"), "--recipe", BENCH.recipe,
                     "--out", WORK / "never.yaml")
        self.assertFalse((WORK / "never.yaml").exists())

    def test_a_rule_stands_instead_of_the_stations_limit(self):
        without = self.judged("bad_colour", BENCH.recipe, "reject")
        self.assertTrue(without["reason_bits"] & COLOUR)
        part = self.judged("bad_colour", ruled("any_colour", "reading: delta_e00, high: 100"), "reject")
        self.assertFalse(part["reason_bits"] & COLOUR, part["reasons"])
        without = self.judged("stain", BENCH.recipe, "reject")
        self.assertTrue(without["reason_bits"] & LOCAL_DEFECT)
        part = self.judged("stain", ruled("stains", "reading: defects, high: 50"), "pass", 0)
        sizes = [d["size_mm"] for d in part["defects"]]
        self.assertEqual(part["rules"][0]["value"], len(sizes))
        part = self.judged("stain", ruled("stain_size", f"reading: defect_size_mm, high: {max(sizes) - 0.5:.3f}"), "reject")
        self.assertTrue(part["reason_bits"] & LOCAL_DEFECT, part["reasons"])

    def test_a_recipe_edited_by_hand_is_judged_by_and_checked(self):
        text = ruled("by_hand", "reading: l_star, cluster: body, low: 1").read_text()
        self.assertIn("low: 1}", text)
        file = WORK / "edited.recipe.yaml"
        file.write_text(text.replace("low: 1}", "low: 99}"))
        self.judged("good", file, "reject", COLOUR)
        line = next(i for i, t in enumerate(text.splitlines(), 1) if "low: 1}" in t)
        file.write_text(text.replace("low: 1}", "lwo: 1}"))
        self.refused([f"edited.recipe.yaml:{line}:", "(rules.rules[0]"], "inspect", "--config", BENCH.station, "--from",
                     self.parts["good"], "--recipe", file)

    def test_rules_that_cannot_be_meant_are_refused_where_they_stand(self):
        for name, says, *rules in (
            ("upside_down", ["upside_down.rules.yaml:4:", "(rules[0].low)", "over high"], "reading: l_star, low: 60, high: 50"),
            ("disjoint", ["disjoint.rules.yaml:5:5 (rules[1])", "contradicts the rule at", "disjoint.rules.yaml:4:5"],
             "reading: l_star, high: 40", "reading: l_star, cluster: body, low: 50"),
            ("against_taught", ["(rules[1])", "contradicts"], "reading: gloss_60_gu, tolerance: 1", "reading: gloss_60_gu, low: 500"),
            ("reading", ["(rules[0].reading)", "did you mean 'gloss_60_gu'"], "reading: glos_60_gu, high: 5"),
            ("cluster", ["(rules[0].cluster)", "no cluster 'lid'", "'body' (0)"], "reading: l_star, cluster: lid, high: 5"),
            ("unit", ["(rules[0].unit)", "GU"], "reading: gloss_60_gu, high: 5, unit: percent"),
            ("range", ["(rules[0].high)", "20 % is 0.2"], "reading: area_share, high: 20"),
            ("negative", ["(rules[0].tolerance)", "-1"], "reading: gloss_60_gu, tolerance: -1"),
            ("haze", ["(rules[0].reading)", "over 70 GU"], "reading: haze_gu, high: 5"),
        ):
            with self.subTest(name):
                self.refused(says, "teach", "--rules", rules_file(name, *rules), "--recipe", BENCH.recipe, "--out", WORK / "no.yaml")
                self.assertFalse((WORK / "no.yaml").exists())
        # While teaching: what needs no parts before any is read, a cluster's name after the first.
        self.refused(["(rules[0].low)"], "teach", "--config", BENCH.station, "--from", BENCH.folder / "no_such_folder", "--rules",
                     WORK / "upside_down.rules.yaml", "--out", WORK / "no.yaml")
        self.refused(["no cluster 'lid'"], "teach", "--config", BENCH.station, "--from", BENCH.folder / "recordings/good", "--rules",
                     WORK / "cluster.rules.yaml", "--out", WORK / "no.yaml")
        self.refused(["neither --from nor --live"], "teach", "--rules", EXAMPLE, "--out", WORK / "no.yaml")

    def test_rules_on_colour_where_none_is_known_are_refused(self):
        station = BENCH.folder / "colourless.yaml"
        station.write_text(BENCH.station.read_text().replace("colour: linear_srgb_d65", "colour: none"))
        self.refused(["rules.rules[0].reading", "delta_e00", "knows none"], "inspect", "--config", station, "--from",
                     self.parts["good"], "--recipe", ruled("no_colour", "reading: delta_e00, high: 1"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
