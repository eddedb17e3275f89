#!/usr/bin/env python3
"""Lights that fail or rise slowly, on the simulated station.    test_lights.py PROGRAMS FOLDER"""
import re
import sys
import unittest

from test_daemon import BENCH, daemon, watch

HARDWARE = 1 << 12


def station(name, scenes, *changes):
    """The small station with other scenes and keys."""
    text = BENCH.station.read_text()
    text = re.sub(r"  scenes: .*\n(\s+- .*\n|\s+#.*\n)+", f"  scenes: [{', '.join(scenes)}]\n", text, count=1)
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    file = BENCH.folder / f"{name}.station.yaml"
    file.write_text(text)
    return file


def dead(light):
    """A good part under a light that gives nothing."""
    drift = ["0", "0"]
    drift[light - 1] = "-1"
    good = (BENCH.folder / "scenes/good.yaml").read_text()
    return BENCH.scene(f"dead{light}", good + f"light: {{drift: [{', '.join(drift)}]}}\n")


class LightsTest(unittest.TestCase):
    def test_a_led_that_stays_dark_is_hardware_until_it_burns_again(self):
        dead(1), dead(2)
        file = station("dead", ["scenes/dead1.yaml", "scenes/dead2.yaml", "scenes/good.yaml"])
        healthy, BENCH.station = BENCH.station, file
        try:
            with daemon("dead", "--recipe", BENCH.recipe) as (_, port):
                for light in (1, 2):
                    code, document = watch(port, "--trigger", light)
                    part = document["parts"][0]
                    self.assertEqual((code, part["verdict"], part["reason_bits"]), (3, "not_judged", HARDWARE), document)
                code, document = watch(port, "--trigger", 3)
                self.assertEqual((code, document["parts"][0]["verdict"]), (0, "pass"), document)
        finally:
            BENCH.station = healthy

    def test_a_recording_under_a_dead_led_is_not_judged_and_names_the_light(self):
        recording = BENCH.simulate(dead(2), "dead2")
        result = BENCH.json("inspect", "--config", BENCH.station, "--from", recording, "--recipe", BENCH.recipe, "--evidence",
                            BENCH.folder / "dead_evidence", codes=(3,))
        part = result["parts"][0]
        self.assertEqual((part["verdict"], part["reason_bits"]), ("not_judged", HARDWARE))
        self.assertIn("light 2 stays dark", part["reasons"][0])

    def test_check_measures_the_rise_that_the_bench_has(self):
        slow = ("  white_exposure_ms: 8\n", "  white_exposure_ms: 8\n  light_rise_ms: 5\n")
        for settle, holds in ((2, False), (25, True)):
            lights = ("rig:\n", f"lights: {{settle_ms: {settle}}}\n\nrig:\n")
            file = station(f"slow{settle}", ["scenes/white.yaml"], slow, lights)
            document = BENCH.json("check", "--lights", file, codes=(0 if holds else 1,))
            self.assertEqual([light["light"] for light in document["lights"]], [1, 2])
            for light in document["lights"]:
                self.assertTrue(light["seen"])
                self.assertEqual(light["holds"], holds)
                # 5 ms ln 100 = 23 ms, less what the exposure averages, as finely as frames fall.
                self.assertAlmostEqual(light["settled_ms"], 22, delta=4)

    def test_pulsed_lights_that_settle_give_the_verdict_of_steady_ones(self):
        slow = ("  white_exposure_ms: 8\n", "  white_exposure_ms: 8\n  light_rise_ms: 2\n")
        for mode in ("steady", "pulsed"):
            lights = ("rig:\n", f"lights: {{settle_ms: 30, mode: {mode}}}\n\nrig:\n")
            file = station(mode, ["scenes/good.yaml"], slow, lights)
            healthy, BENCH.station = BENCH.station, file
            try:
                recording = BENCH.simulate(BENCH.folder / "scenes/good.yaml", f"{mode}_lights", seed=3)
                result = BENCH.json("inspect", "--config", file, "--from", recording, "--recipe", BENCH.recipe)
            finally:
                BENCH.station = healthy
            self.assertEqual(result["parts"][0]["verdict"], "pass", mode)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
