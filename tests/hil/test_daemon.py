#!/usr/bin/env python3
"""The shipped daemon and independent Modbus clients.    test_daemon.py PROGRAMS FOLDER"""
import contextlib
import json
import os
import pathlib
import re
import select
import signal
import subprocess
import sys
import unittest

from bench import Bench

BENCH = Bench(sys.argv[1], sys.argv[2])
HERE = pathlib.Path(__file__).resolve().parent


@contextlib.contextmanager
def daemon(name, *more):
    """brdfgated on a free port, told by its own log when it serves."""
    state = BENCH.folder / f"state_{name}"
    process = subprocess.Popen([str(BENCH.programs / "brdfgated"), "--config", str(BENCH.station), "--port", "0", "--state-dir",
                                str(state), *map(str, more)], stderr=subprocess.PIPE, text=True)
    try:
        log = ""
        while "Modbus TCP on" not in log:
            # Unbuffered: select does not see lines that a buffer has read ahead.
            ready, _, _ = select.select([process.stderr], [], [], 60)
            text = os.read(process.stderr.fileno(), 65536).decode() if ready else ""
            if not text:
                raise AssertionError(f"the daemon did not come up: {log}")
            log += text
        yield process, int(re.search(r"Modbus TCP on \S+:(\d+)", log).group(1))
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=30)


def watch(port, *more):
    done = BENCH.run("plc", "watch", "127.0.0.1", "--port", port, "--json", *more)
    return done.returncode, json.loads(done.stdout) if done.stdout else done.stderr


class DaemonTest(unittest.TestCase):
    def test_the_contract_holds_for_pymodbus_and_mbpoll(self):
        with daemon("contract", "--recipe", BENCH.recipe) as (_, port):
            done = subprocess.run(["/usr/bin/python3", str(HERE / "plc_contract.py"), "127.0.0.1", str(port)],
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=240, check=False)
            self.assertEqual(done.returncode, 0, done.stdout)

    def test_good_and_bad_parts_are_told_apart_over_modbus(self):
        with daemon("story", "--recipe", BENCH.recipe) as (_, port):
            code, document = watch(port, "--trigger", 1, 2, 3, 4, 5)
            self.assertEqual([p["verdict"] for p in document["parts"]], ["pass", "reject", "reject", "reject", "not_judged"], document)
            self.assertEqual(code, 1)

    def test_switching_recipes_costs_no_restart(self):
        rules = BENCH.folder / "no_gloss.rules.yaml"
        rules.write_text("schema: brdfgate.rules/1\nrules:\n  - {reading: gloss_60_gu, cluster: region 1, high: 1}\n")
        strict = BENCH.folder / "strict.recipe.yaml"
        BENCH.json("teach", "--rules", rules, "--recipe", BENCH.recipe, "--out", strict, "--id", 2, "--name", "strict")
        config = BENCH.station
        BENCH.station = BENCH.folder / "two_recipes.yaml"
        BENCH.station.write_text(config.read_text().replace("recipes: []", f"recipes: [{BENCH.recipe.name}, {strict.name}]"))
        try:
            with daemon("two_recipes") as (process, port):
                for recipe, verdict, gloss in ((1, "pass", 0), (2, "reject", 1), (1, "pass", 0)):
                    # Trigger 1 shows the good part, whatever recipe is in force.
                    _, document = watch(port, "--recipe", recipe, "--trigger", 1)
                    part = document["parts"][0]
                    self.assertEqual(part["verdict"], verdict, document)
                    self.assertEqual(part["reason_bits"] >> 6 & 1, gloss, document)
                self.assertIsNone(process.poll())
        finally:
            BENCH.station = config
        counters = json.loads((BENCH.folder / "state_two_recipes/counters.json").read_text())["counters"]
        self.assertEqual((counters["inspected"], counters["restarts"]), (3, 1))  # one start

    def test_evidence_explains_the_last_part(self):
        folder = BENCH.folder / "daemon_evidence"
        for recipe, trigger, verdict in ((["--recipe", BENCH.recipe], 2, "reject"), ([], 1, "not judged")):
            with daemon("evidence", "--evidence", folder, *recipe) as (_, port):
                watch(port, "--trigger", trigger)
            # What waits is drawn before the daemon ends.
            page = (folder / "explain.html").read_text()
            self.assertIn(f"part {trigger}", page)
            self.assertIn(verdict, page)
            self.assertTrue((folder / "regions.png").exists(), list(folder.iterdir()))

    def test_without_a_recipe_everything_is_not_judged_with_weights(self):
        with daemon("bare") as (_, port):
            code, document = watch(port, "--trigger", 1)
            self.assertEqual(code, 3)
            self.assertEqual(document["parts"][0]["verdict"], "not_judged")

    def test_counters_survive_a_restart_and_sigterm_ends_cleanly(self):
        for restarts in (1, 2):
            with daemon("counted", "--recipe", BENCH.recipe) as (process, port):
                watch(port, "--trigger", 1)
            self.assertEqual(process.returncode, 0)
        counters = json.loads((BENCH.folder / "state_counted/counters.json").read_text())
        self.assertEqual(json.dumps(counters).count('"inspected": 2') + json.dumps(counters).count('"inspected":2'), 1, counters)

    def test_an_unusable_scene_is_a_fault_that_the_next_part_survives(self):
        broken = BENCH.folder / "scenes/broken.yaml"
        broken.write_text("target: nonsense\n")
        station = BENCH.folder / "broken.station.yaml"
        text = BENCH.station.read_text()
        station.write_text(re.sub(r"scenes: .*\n(\s+- .*\n|\s+#.*\n)+", "scenes: [scenes/broken.yaml, scenes/good.yaml]\n", text, count=1))
        config, BENCH.station = BENCH.station, station
        try:
            with daemon("broken", "--recipe", BENCH.recipe) as (_, port):
                code, document = watch(port, "--trigger", 1)
                self.assertEqual((code, document["parts"][0]["verdict"]), (3, "not_judged"), document)
        finally:
            BENCH.station = config


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
