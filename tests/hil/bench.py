"""What the tests of the shipped programs share: a small simulated station in a folder of its own."""
import json
import pathlib
import re
import shutil
import subprocess
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
WIDTH, HEIGHT = 728, 544  # half of the default sensor each way: the same rig, four times faster


class Bench:
    """Programs and files of one test run."""

    def __init__(self, programs, folder):
        self.programs = pathlib.Path(programs)
        self.folder = pathlib.Path(folder)
        self.station = self.folder / "station.yaml"
        self.recipe = self.folder / "good.recipe.yaml"
        self.calibration = self.folder / "station.calibration.exr"

    def run(self, *arguments, timeout=120):
        command = [self.programs / "brdfgate", *arguments]
        return subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                              timeout=timeout, check=False)

    def json(self, *arguments, codes=(0,)):
        done = self.run(*arguments, "--json")
        if done.returncode not in codes:
            raise AssertionError(f"{arguments}: exit code {done.returncode}\n{done.stderr}")
        return json.loads(done.stdout)

    def simulate(self, scene, name, parts=1, seed=1):
        out = self.folder / "recordings" / name
        shutil.rmtree(out, ignore_errors=True)
        self.json("simulate", "--config", self.station, "--scene", scene, "--out", out, "--parts", parts, "--seed", seed)
        return out

    def scene(self, name, text):
        """Writes a scene beside the shipped ones, so that relative paths hold."""
        file = self.folder / "scenes" / f"{name}.yaml"
        file.write_text(text)
        return file


class Refusals(unittest.TestCase):
    """Input that a program must refuse."""

    def assert_refused(self, done, says):
        """Exit code 2, and one line that has every text of `says`."""
        self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
        lines = done.stderr.strip().splitlines()
        self.assertEqual(len(lines), 1, done.stderr)
        for text in says:
            self.assertIn(text, lines[0])


def small_station(text):
    """The shipped station file with a small sensor, its basis found, and counters kept nearby."""
    text = re.sub(r"width: 1456", f"width: {WIDTH}", text)
    text = re.sub(r"height: 1088", f"height: {HEIGHT}", text)
    text = re.sub(r"basis: .*", f"basis: {ROOT}/config/basis/merl.basis", text)
    return re.sub(r"state_dir: \S+", "state_dir: state", text)
