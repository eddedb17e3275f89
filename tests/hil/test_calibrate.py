#!/usr/bin/env python3
"""Calibrating the station with the shipped tool, from recordings and live.    test_calibrate.py PROGRAMS FOLDER"""
import contextlib
import json
import re
import shutil
import socket
import struct
import subprocess
import sys
import unittest

import test_daemon
from bench import Bench, Refusals

BENCH = Bench(sys.argv[1], sys.argv[2])
WORK = BENCH.folder / "calibrate"
RECORDINGS = BENCH.folder / "recordings"
DEVIATION = """  deviation: {camera_mm: [3, -2, 4], camera_deg: [0.4, -0.3, 0.5], focal: 0.01, distortion: [-0.08, 0.1, 0, 0, 0],
    lights_mm: [[8, -6, 10], [-7, 9, -8]], aim_mm: [[4, 3, 0], [-3, 5, 0]]}
"""
SCENES = {
    "bent": "target: white\nreference: {sag_mm: 1}\n",
    "shadow": "target: white\ndefects: [{kind: stain, at_mm: [10, -5], size_mm: 12, strength: 0.3}]\n",
    "dead_light": "target: white\nlight: {drift: [-1, 0]}\n",
    "board_out": "target: board\npose: {shift_mm: [0, 40]}\n",
    "board_not_flat": "target: board\npose: {tilt_deg: [0, 12]}\n",
    "room": "target: black\nlights_on: false\nlight: {ambient: 2}\n",
}
WHAT = {"dark": 2, "white": 2, "board": 1, "board_tilted": 6, "mirror": 1, "white_raised": 1, "black": 1}


def station(name, *changes):
    """The small station with other text in some places."""
    text = BENCH.station.read_text()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    file = BENCH.folder / f"{name}.station.yaml"
    file.write_text(text)
    return file


def simulate(config, scene, name, parts=1, seed=7, *more):
    out = RECORDINGS / "calibrate" / name
    shutil.rmtree(out, ignore_errors=True)
    BENCH.json("simulate", "--config", config, "--scene", scene, "--out", out, "--parts", parts, "--seed", seed, *more)
    return out


def scene(name):
    return BENCH.folder / "scenes" / f"{name}.yaml"


def swap_exposures(recording):
    """Two exposures under light 1 written down for each other."""
    file = recording / "recording.yaml"
    lines = file.read_text().splitlines()
    rows = [i for i, line in enumerate(lines) if re.search(r"light: ['\"]?0\b", line)]
    a, b = rows[0], rows[-1]
    times = [re.search(r"exposure_s: ([^,]+)", lines[i]).group(1) for i in (a, b)]
    assert times[0] != times[1], times
    lines[a] = lines[a].replace(f"exposure_s: {times[0]}", f"exposure_s: {times[1]}")
    lines[b] = lines[b].replace(f"exposure_s: {times[1]}", f"exposure_s: {times[0]}")
    file.write_text("\n".join(lines) + "\n")


class Calibrate(Refusals):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        WORK.mkdir()
        for name, text in SCENES.items():
            scene(name).write_text(text)
        cls.config = station("deviated", ("  white_exposure_ms: 8\n", "  white_exposure_ms: 8\n" + DEVIATION))
        cls.rec = {key: simulate(cls.config, scene(key), key, n) for key, n in WHAT.items()}
        cls.rec["ptc"] = simulate(cls.config, scene("white"), "ptc", 1, 7, "--role", "ptc")
        cls.out = WORK / "station.exr"

    def calibrate(self, *recordings, codes=(0,), more=(), config=None, out=None):
        return BENCH.json("calibrate", "--config", config or self.config, "--from", *recordings, "--out", out or WORK / "x.exr", *more,
                          codes=codes)

    def refused(self, *recordings, says, config=None, more=()):
        out = WORK / "refused.exr"
        done = BENCH.run("calibrate", "--config", config or self.config, "--from", *recordings, "--out", out, *more)
        self.assert_refused(done, says)
        self.assertFalse(out.exists())

    def levels(self, *without):
        return [self.rec[key] for key in ("dark", "white") if key not in without]

    def test_everything_recorded_gives_a_calibration_and_a_report(self):
        page = WORK / "report.html"
        found = self.calibrate(*(self.rec[k] for k in ("dark", "ptc", "white", "board", "board_tilted", "mirror", "black")), out=self.out,
                               more=("--raised-white", "10", self.rec["white_raised"], "--report", page))
        transfer = found["photon_transfer"]
        self.assertAlmostEqual(transfer["gain_dn_per_electron"] / 0.0963, 1, delta=0.02)
        self.assertAlmostEqual(transfer["full_well_dn"], 1023, delta=1)
        self.assertLess(transfer["linearity_percent"], 0.5)
        self.assertEqual(found["gain_dn_per_electron"], transfer["gain_dn_per_electron"])
        self.assertLess(found["camera"]["rms_px"], 0.3)
        self.assertEqual([light["source"] for light in found["lights"]], ["fitted", "fitted"])
        for share in found["stray_share"]:
            self.assertAlmostEqual(share, 0.005 / 0.99, delta=0.001)
        self.assertEqual(found["warnings"], [])
        html = page.read_text()
        self.assertEqual(html.count("data:image/png;base64,"), 6)  # two whites, noise, corners, two falloffs
        self.assertIn(found["hash"], html)
        # The result of a part carries the calibration that it was measured with, and so does its recording.
        config = station("calibrated", ("  white_exposure_ms: 8\n", "  white_exposure_ms: 8\n" + DEVIATION),
                         ("calibration: station.calibration.exr", f"calibration: {self.out}"))
        part = simulate(config, scene("good"), "part")
        self.assertIn(found["hash"], (part / "part_0001/recording.yaml").read_text())
        result = BENCH.json("reconstruct", "--config", config, "--from", part, "--out", WORK / "part")
        self.assertEqual(result["parts"][0]["calibration"], found["hash"])

    def test_bad_captures_are_named(self):
        boards = [self.rec["board"], self.rec["board_tilted"]]
        for name, says in (("bent", ["bent"]), ("shadow", ["light", "in shadow or dirty"]), ("dead_light", ["white is dark under light 1"])):
            with self.subTest(name):
                self.refused(self.rec["dark"], simulate(self.config, scene(name), name), *boards, says=says)
        with self.subTest("board out of frame"):
            self.refused(*self.levels(), simulate(self.config, scene("board_out"), "board_out"),
                         says=["board_out", "no whole checkerboard"])
        with self.subTest("first board not flat"):
            self.refused(*self.levels(), simulate(self.config, scene("board_not_flat"), "board_not_flat"),
                         says=["board_not_flat", "flat in the nest"])
        with self.subTest("light in the dark"):
            self.refused(simulate(self.config, scene("room"), "room"), self.rec["white"], says=["darks[0]", "dark"])
        with self.subTest("white for black"):
            black = simulate(self.config, scene("white"), "not_black", 1, 7, "--role", "black")
            self.refused(*self.levels(), black, says=["not_black", "the black gauge shows"])
        with self.subTest("no mirror"):
            mirror = simulate(self.config, scene("white"), "no_mirror", 1, 7, "--role", "mirror")
            self.refused(*self.levels(), *boards, mirror, says=["no_mirror", "no highlight"])

    def test_swapped_exposure_times_are_named(self):
        for key, says in (("white", ["whites[0]", "light 1", "exposures mixed up"]),):
            copy = WORK / f"swapped_{key}"
            shutil.rmtree(copy, ignore_errors=True)
            shutil.copytree(self.rec[key], copy)
            swap_exposures(copy / "part_0001")
            with self.subTest(key):
                self.refused(self.rec["dark"], copy, says=says)
        sweep = WORK / "swapped_ptc"
        shutil.rmtree(sweep, ignore_errors=True)
        shutil.copytree(self.rec["ptc"], sweep)
        file = sweep / "part_0001/recording.yaml"
        text = file.read_text()
        times = sorted(set(re.findall(r"exposure_s: ([^,]+)", text)), key=float)
        low, high = times[4], times[-6]
        file.write_text(text.replace(f"exposure_s: {low},", "exposure_s: X,").replace(f"exposure_s: {high},", f"exposure_s: {low},")
                        .replace("exposure_s: X,", f"exposure_s: {high},"))
        self.refused(*self.levels(), sweep, says=["photon-transfer sweep", "the signal falls"])

    def test_a_tone_curve_that_nobody_configured_is_found(self):
        config = station("gamma", ("  white_exposure_ms: 8\n", "  white_exposure_ms: 8\n  gamma: 1.3\n"))
        sweep = simulate(config, scene("white"), "gamma_ptc", 1, 7, "--role", "ptc")
        self.refused(*self.levels(), sweep, says=["the camera is not linear", "tone_curve"])

    def test_a_foreign_and_an_old_calibration_are_refused_by_name(self):
        other = station("other_rig", ("field_of_view_deg: 25", "field_of_view_deg: 25.5"))
        done = BENCH.run("bracket", "--config", other, "--calibration", BENCH.calibration, "--from", RECORDINGS / "good")
        self.assertEqual(done.returncode, 2)
        self.assertIn("station.calibration.exr", done.stderr)
        self.assertIn("another sensor or rig", done.stderr)
        # A part recorded under the calibration before is not judged by a new one unasked.
        newer = WORK / "newer.exr"
        BENCH.json("calibrate", "--config", BENCH.station, "--from", RECORDINGS / "dark", RECORDINGS / "white", "--certificate", "new", "--out", newer)
        config = station("renewed", ("calibration: station.calibration.exr", f"calibration: {newer}"))
        done = BENCH.run("inspect", "--config", config, "--from", RECORDINGS / "good/part_0001")
        self.assertEqual(done.returncode, 2)
        self.assertIn("is not the one in force", done.stderr)

    def test_the_walk_asks_again_for_what_is_not_usable(self):
        shutil.rmtree(WORK / "walk", ignore_errors=True)
        out = WORK / "walk.exr"
        answers = [scene("room"), "", "",  # dark: first with a light on
                   "s",  # sweep
                   scene("board_out"), "",  # board
                   "", "", "", "", "s",  # tilted boards: four
                   scene("bent"), "", scene("shadow"), "",  # white
                   "s",  # raised
                   scene("white"), "",  # mirror
                   "", "", ""]  # black, chart, open nest
        done = subprocess.run([str(BENCH.programs / "brdfgate"), "calibrate", "--config", str(self.config), "--live", "--spacer-mm", "10",
                               "--scenes", str(BENCH.folder / "scenes"), "--record", str(WORK / "walk"), "--out", str(out), "--json"],
                              input="\n".join(map(str, answers)) + "\n", stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                              timeout=300, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads(done.stdout)
        self.assertEqual((report["darks"], report["whites"], report["boards"], report["mirrors"]), (2, 2, 5, 1))
        self.assertLess(report["colour"]["de00_mean"], 1)
        self.assertEqual(done.stderr.count("not usable:"), 5, done.stderr)
        for text in ("Cover the lens", "no whole checkerboard", "bent", "in shadow", "no highlight", "reprojection error", "falloff residual"):
            self.assertIn(text, done.stderr)
        # What it kept gives the same figures again.
        kept = WORK / "walk"
        again = self.calibrate(*(kept / k for k in ("dark", "board", "board_tilted", "white", "mirror", "black")))
        self.assertEqual(again["camera"], report["camera"])
        self.assertEqual(again["stray_share"], report["stray_share"])

    def test_a_walk_that_ends_early_leaves_no_calibration(self):
        for answers, says in (("\n", "standard input: ended at step 'dark'"), ("\nq\n", "given up at step 'dark'")):
            out = WORK / "early.exr"
            done = subprocess.run([str(BENCH.programs / "brdfgate"), "calibrate", "--config", str(self.config), "--live", "--out", str(out)],
                                  input=answers, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=120, check=False)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(says, done.stderr)
            self.assertFalse(out.exists())

    def test_the_bracket_for_a_material_is_chosen_and_does_what_it_says(self):
        matt = BENCH.scene("matt", "target: part\nmaterials:\n  - {name: m, lambert: [0.3, 0.4, 0.5]}\n")
        one = BENCH.json("bracket", "--config", BENCH.station, "--from", BENCH.simulate(matt, "matt"))
        self.assertEqual(len(one["bracket_ms"]), 1)
        chosen = BENCH.json("bracket", "--config", BENCH.station, "--from", RECORDINGS / "good/part_0001")
        self.assertLess(chosen["masked_share"], 0.001)
        listed = ", ".join(map(str, chosen["bracket_ms"]))
        station("chosen", ("bracket_ms: [0.03, 0.4, 5, 60]", f"bracket_ms: [{listed}]"))
        again = RECORDINGS / "calibrate/chosen"
        shutil.rmtree(again, ignore_errors=True)
        BENCH.json("simulate", "--config", BENCH.folder / "chosen.station.yaml", "--scene", scene("good"), "--out", again, "--seed", 77)
        config = ("--config", BENCH.folder / "chosen.station.yaml")
        # The bracket itself is among the candidates now, so it must still do.
        still = BENCH.json("bracket", *config, "--from", again, "--max-masked", "0.002")
        self.assertLessEqual(len(still["bracket_ms"]), len(chosen["bracket_ms"]))
        text = BENCH.run("bracket", *config, "--from", again, "--max-masked", "0.002").stdout
        self.assertRegex(text, r"^camera:\n  bracket_ms: \[[0-9., ]+\]  # leaves")
        done = BENCH.run("bracket", "--config", BENCH.station, "--from", RECORDINGS / "good/part_0001", "--budget-ms", "2")
        self.assertEqual(done.returncode, 2)
        self.assertIn("no bracket leaves under", done.stderr)

    def test_an_eight_bit_camera_with_a_tone_curve_measures_reflectance(self):
        config = station("toned", ("bits: 10", "bits: 8"), ("black_level_dn: 60", "black_level_dn: 6"), ("full_well_dn: 1023", "full_well_dn: 250"),
                         ("gain_dn_per_electron: 0.0963", "gain_dn_per_electron: 0.0244"), ("response: linear", "response: tone_curve"),
                         ("bracket_ms: [0.03, 0.4, 5, 60]", "bracket_ms: [0.5, 2, 8, 32]"),
                         ("  white_exposure_ms: 8\n", "  white_exposure_ms: 8\n  gamma: 2.2\n"),
                         ("calibration: station.calibration.exr", "calibration: toned.exr"))
        dark = simulate(config, scene("dark"), "toned_dark", 2)
        white = simulate(config, scene("white"), "toned_white", 2)
        self.refused(dark, white, config=config, says=["no recording of the camera's tone curve"])
        sweep = simulate(config, scene("white"), "toned_ptc", 1, 7, "--role", "ptc")
        self.calibrate(dark, sweep, white, config=config, out=BENCH.folder / "toned.exr")
        grey = BENCH.scene("toned_grey", "target: part\nmaterials:\n  - {name: grey, lambert: [0.2, 0.4, 0.6]}\n")
        part = simulate(config, grey, "toned_part")
        result = BENCH.json("reconstruct", "--config", config, "--from", part, "--out", WORK / "toned")
        cluster = result["parts"][0]["clusters"][0]
        luminance = 0.2126 * 0.2 + 0.7152 * 0.4 + 0.0722 * 0.6
        self.assertAlmostEqual(cluster["lab"][0], 116 * luminance ** (1 / 3) - 16, delta=3)


def registers(port, address, count):
    """Input registers, without anybody's library."""
    with contextlib.closing(socket.create_connection(("127.0.0.1", port), timeout=10)) as link:
        link.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, address, count))
        reply = b""
        while len(reply) < 9 + 2 * count:
            reply += link.recv(1024)
    return struct.unpack(f">{count}H", reply[9:9 + 2 * count])


class Due(unittest.TestCase):
    """An overdue calibration warns, and past its grace nothing is judged."""

    def overdue(self, name, grace_days):
        calibration = WORK / f"{name}.exr"
        WORK.mkdir(exist_ok=True)
        BENCH.json("calibrate", "--config", BENCH.station, "--from", RECORDINGS / "dark", RECORDINGS / "white", "--certificate", "T",
                   "--certificate-due", "2026-01-15", "--out", calibration)
        config = station(name, ("calibration: station.calibration.exr", f"calibration: {calibration}"),
                         ("grace_days: 30", f"grace_days: {grace_days}"))
        recipe = BENCH.folder / f"{name}.recipe.yaml"
        BENCH.json("teach", "--config", config, "--calibration", calibration, "--from", *sorted((RECORDINGS / "good").iterdir())[:4], "--out", recipe,
                   "--name", "good part")
        return config, recipe

    def test_it_warns_and_then_judges_no_more(self):
        for name, grace, verdict in (("in_grace", 36500, "pass"), ("expired", 1, "not_judged")):
            config, recipe = self.overdue(name, grace)
            usual, test_daemon.BENCH.station = BENCH.station, config
            try:
                with self.subTest(name), test_daemon.daemon(name, "--recipe", recipe) as (_, port):
                    status, _, _, warnings = registers(port, 4, 4)
                    self.assertTrue(status >> 11 & 1, "status: calibration_due")
                    self.assertTrue(status >> 9 & 1, "status: warning")
                    self.assertTrue(warnings >> 4 & 1, "warning: recalibration due")
                    document = json.loads(BENCH.run("plc", "watch", "127.0.0.1", "--port", port, "--trigger", 1, "--json").stdout)
                    part = document["parts"][0]
                    self.assertEqual(part["verdict"], verdict, part)
                    self.assertEqual(part["reason_bits"] >> 15 & 1, int(verdict == "not_judged"))
            finally:
                test_daemon.BENCH.station = usual

    def test_a_calibration_without_a_due_date_does_not_warn(self):
        with test_daemon.daemon("not_due", "--recipe", BENCH.recipe) as (_, port):
            status, _, _, warnings = registers(port, 4, 4)
            self.assertFalse(status >> 11 & 1)
            self.assertFalse(warnings >> 4 & 1)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
