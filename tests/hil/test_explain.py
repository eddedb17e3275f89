#!/usr/bin/env python3
"""The page and the text that say why: for a pass, a reject, and parts that were not judged.    test_explain.py PROGRAMS FOLDER"""
import base64
import html.parser
import sys
import unittest

from bench import Bench

BENCH = Bench(sys.argv[1], sys.argv[2])
VOID = {"meta", "img", "br", "hr", "col", "link", "input"}


class Page(html.parser.HTMLParser):
    """Every tag closed in its turn; text, tags and pictures kept."""

    def __init__(self, markup):
        super().__init__()
        self.open, self.text, self.tags, self.pictures, self.problems = [], "", [], [], []
        self.feed(markup)
        self.close()
        if self.open:
            self.problems.append(f"left open: {self.open}")

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("href", "src", "action") or name.startswith("on"):
                if not (value or "").startswith("data:image/png;base64,"):
                    self.problems.append(f"<{tag} {name}={value!r:.60}>")
                else:
                    self.pictures.append(base64.b64decode(value.split(",", 1)[1], validate=True))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.problems.append(f"</{tag}> closes something else")

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data


class Explain(unittest.TestCase):
    def explained(self, scene, *more, name=None, seed=900):
        recordings = BENCH.simulate(BENCH.folder / "scenes" / f"{scene}.yaml", name or f"explain_{scene}", seed=seed)
        folder = BENCH.folder / "evidence" / (name or scene)
        command = ["inspect", "--config", BENCH.station, "--from", recordings, "--evidence", folder, *more]
        said = BENCH.run(*command).stdout
        part = BENCH.json(*command, codes=(0, 1, 3))["parts"][0]
        markup = (folder / "explain.html").read_text()
        page = Page(markup)
        self.assertEqual(page.problems, [])
        self.assertTrue(markup.startswith("<!DOCTYPE html>"))
        for tag in ("script", "link", "iframe", "object"):
            self.assertNotIn(tag, page.tags)
        self.assertNotRegex(markup, r"https?://|@import|url\(")
        for png in page.pictures:
            self.assertEqual(png[:8], b"\x89PNG\r\n\x1a\n")
        for reason in part["reasons"]:
            self.assertIn(reason, page.text)
            self.assertIn(reason, said)
        for words in (part["verdict"].upper().replace("_", " "), part["calibration"], "part_0001"):
            self.assertIn(words, page.text)
        return part, page, said

    def test_a_pass_shows_every_value_within_its_limit(self):
        part, page, said = self.explained("good", "--recipe", BENCH.recipe, seed=501)
        self.assertEqual(part["verdict"], "pass", part["reasons"])
        self.assertNotIn("beyond", page.text.replace("beyond the limit, but", ""))
        self.assertNotIn("What is missing", page.text)
        self.assertNotIn("BEYOND", said)
        for words in ("T2", "SPE", "roughness", "gloss level", "largest local departure", "good part", "recipe hash", "station hash"):
            self.assertIn(words, page.text)
        # Regions, two residuals, two lights, and two spheres for each of two materials.
        self.assertEqual(len(page.pictures), 3 + 2 + 2 * 2)

    def test_readings_have_intervals_that_hold_them_and_say_where_they_are_from(self):
        part, page, _ = self.explained("good", "--recipe", BENCH.recipe, name="explain_readings", seed=502)
        for cluster in part["clusters"]:
            for angle, value in cluster["gloss_gu"].items():
                low, high = cluster["gloss_interval_gu"][angle]
                self.assertTrue(0 <= low < value < high, cluster)
                self.assertGreater(cluster["gloss_sigma_gu"][angle], 0)
                self.assertIn(f"{low:.2f} to {high:.2f}", page.text)
            self.assertEqual(cluster["gloss_measured"], {"20": False, "60": True, "85": False})
            self.assertTrue(all(s > 0 for s in cluster["lab_sigma"]))
            for at in cluster["appearance"]["aspecular_deg"].values():
                self.assertEqual(at["lightness_sigma"], at["lab_sigma"][0])
        self.assertIn("extrapolated", page.text)
        self.assertIn("measured", page.text)

    def test_a_rejected_part_shows_what_is_beyond_its_limit(self):
        part, page, said = self.explained("bad_gloss", "--recipe", BENCH.recipe)
        self.assertEqual(part["verdict"], "reject")
        self.assertIn("beyond", page.text)
        self.assertIn("BEYOND", said)

    def test_a_stain_is_listed_and_ringed(self):
        part, page, _ = self.explained("stain", "--recipe", BENCH.recipe)
        self.assertIn("Local defects", page.text)
        self.assertIn(f"{part['defects'][0]['at_mm'][0]:+.1f}", page.text)

    def test_an_absent_part_has_a_page_that_says_so(self):
        part, page, said = self.explained("absent", "--recipe", BENCH.recipe)
        self.assertEqual(part["verdict"], "not_judged")
        for text in (page.text, said):
            self.assertIn("nothing of the part was measured", text)
        self.assertNotIn("beyond", page.text)

    def test_without_a_recipe_the_page_shows_what_was_found(self):
        part, page, _ = self.explained("good", name="explain_no_recipe")
        self.assertEqual(part["verdict"], "not_judged")
        self.assertIn("no recipe is in force", page.text)
        self.assertIn("90 % interval", page.text)

    def test_a_part_whose_lights_failed_has_a_page_without_pictures(self):
        scene = BENCH.scene("dead_light", (BENCH.folder / "scenes/good.yaml").read_text() + "\nlight: {drift: [0, -1]}\n")
        part, page, said = self.explained(scene.stem, "--recipe", BENCH.recipe)
        self.assertEqual(part["verdict"], "not_judged")
        self.assertEqual(page.pictures, [])
        for text in (page.text, said):
            self.assertIn("nothing was measured", text)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
