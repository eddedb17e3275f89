#!/usr/bin/env python3
"""Every unusable input gets one clear line and exit code 2.    test_bad_input.py PROGRAMS FOLDER"""
import shutil
import socket
import struct
import subprocess
import sys
import unittest
import zlib

from bench import Bench, Refusals, ROOT

BENCH = Bench(sys.argv[1], sys.argv[2])
WORK = BENCH.folder / "bad"


def copy(name):
    """A fresh copy of a good recording."""
    target = WORK / name
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(BENCH.folder / "recordings/good/part_0001", target)
    return target


def cut(file, share):
    data = file.read_bytes()
    file.write_bytes(data[: int(len(data) * share)])
    return file


def merl(file, value, cell=None, instead=None):
    """A MERL .binary that has one value everywhere, but for one cell of the first channel, (theta_h, theta_d, phi_d)."""
    size = (90, 90, 180)
    data = bytearray(struct.pack("<3i", *size) + struct.pack("<d", value) * (3 * size[0] * size[1] * size[2]))
    if cell is not None:
        struct.pack_into("<d", data, 12 + 8 * ((cell[0] * size[1] + cell[1]) * size[2] + cell[2]), instead)
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(data)


class Refused(Refusals):
    def refused(self, *arguments, says):
        self.assert_refused(BENCH.run(*arguments), says)


class BadModelInput(Refused):
    """What bases are trained on and rigs are designed from."""
    BASIS = ROOT / "config/basis/merl.basis"

    @classmethod
    def setUpClass(cls):
        cls.folder = BENCH.folder / "bad_model"
        shutil.rmtree(cls.folder, ignore_errors=True)
        cls.folder.mkdir()
        merl(cls.folder / "good/a.binary", 150.0)
        merl(cls.folder / "good/b.binary", 300.0)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)  # 35 MB a material

    def not_built(self, *more, says):
        out = self.folder / "out.basis"
        self.refused("basis", "build", "--materials", self.folder / "good", *more, "--out", out, says=says)
        self.assertFalse(out.exists())

    def test_materials_with_values_that_no_surface_has(self):
        inside = (40, 20, 90)
        for name, value, instead, says in (
            ("nan", 150.0, float("nan"), ["channel 0", "(40, 20, 90)", "nan"]),
            ("infinite", 150.0, float("inf"), ["channel 0", "(40, 20, 90)", "inf"]),
            ("negative", 150.0, -0.25, ["channel 0", "-0.25"]),
            ("all_missing", -1.0, -1.0, ["channel 0", "no valid cell"]),
        ):
            with self.subTest(name):
                file = self.folder / f"{name}.binary"
                merl(file, value, inside, instead)
                self.not_built("--materials", file, "--components", "3", says=[file.name, *says])
                file.unlink()

    def test_two_materials_of_one_name(self):
        merl(self.folder / "other/a.binary", 100.0)
        self.not_built("--materials", self.folder / "other", "--components", "3",
                       says=["other/a.binary", "good/a.binary", "each material once"])

    def test_too_few_materials_for_the_components(self):
        self.not_built("--components", "6", says=["components: 6", "1 to 5 for 2 materials"])
        self.not_built("--components", "1", "--leave-out", "b", says=["1 material", "at least 2"])

    def test_a_rig_that_sees_nothing(self):
        rig = ["design", "rig", "--basis", self.BASIS, "--camera-deg", "50", "--light", "20,0", "--light"]
        self.refused(*rig, "89.95,0", says=["image 2", "sees nothing"])
        self.refused(*rig, "95,0", says=["light of image 2", "95"])
        self.refused(*rig, "120", says=["--light", "'120'", "such as 20,180"])

    def test_directions_below_the_horizon(self):
        csv = self.folder / "below.csv"
        csv.write_text("theta_h_deg,theta_d_deg,phi_d_deg\n10,20,0\n80,60,0\n")
        says = ["below.csv:3", "below the horizon"]
        self.refused("design", "points", "--basis", self.BASIS, "--from", csv, says=says)
        self.refused("design", "path", "--from", csv, "--out", self.folder / "path.csv", says=says)
        measured = self.folder / "below.brdf"
        measured.write_text("0.2 0 0.3 1 0.3 0.4 0.5\n0.2 0 1.7 1 0.3 0.4 0.5\n")
        self.refused("basis", "goniometer", self.BASIS, "--list", measured, says=["below.brdf:2", "theta_o 1.7", "horizon"])


class BadInput(Refused):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        WORK.mkdir()

    def inspect(self, recording, *more, says):
        self.refused("inspect", "--config", BENCH.station, "--from", recording, *more, says=says)

    def test_a_truncated_basis(self):
        basis = WORK / "short.basis"
        shutil.copy(ROOT / "config/basis/merl.basis", basis)
        self.inspect(copy("a"), "--basis", cut(basis, 0.5), says=["short.basis", "size"])

    def test_a_damaged_basis(self):
        basis = WORK / "damaged.basis"
        data = bytearray((ROOT / "config/basis/merl.basis").read_bytes())
        data[-1000] ^= 0x55
        basis.write_bytes(data)
        self.inspect(copy("b"), "--basis", basis, says=["damaged.basis", "checksum"])

    def test_a_foreign_basis(self):
        (WORK / "foreign.basis").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(4096))
        self.inspect(copy("c"), "--basis", WORK / "foreign.basis", says=["foreign.basis", "magic"])

    def test_a_truncated_merl_file(self):
        (WORK / "short.binary").write_bytes(bytes(1000))
        self.refused("compare", WORK / "short.binary", WORK / "short.binary", says=["short.binary"])

    def test_a_truncated_png(self):
        recording = copy("d")
        cut(sorted(recording.glob("*.png"))[0], 0.5)
        self.inspect(recording, says=[".png"])

    def test_a_missing_exposure(self):
        recording = copy("e")
        sorted(recording.glob("*.png"))[1].unlink()
        self.inspect(recording, says=[".png"])

    def test_a_recording_without_ambient_frames(self):
        recording = copy("f")
        file = recording / "recording.yaml"
        file.write_text(file.read_text().replace("light: none", "light: 1"))
        self.inspect(recording, says=["ambient"])

    def test_mixed_sizes(self):
        recording = copy("g")
        file = recording / "recording.yaml"
        file.write_text(file.read_text().replace("width: 728", "width: 730"))
        self.inspect(recording, says=["730"])

    def test_a_recording_of_another_station(self):
        recording = copy("h")
        file = recording / "recording.yaml"
        lines = [f"station: {'0' * 64}" if line.startswith("station:") else line for line in file.read_text().splitlines()]
        file.write_text("\n".join(lines) + "\n")
        self.inspect(recording, says=["station"])

    def test_a_recording_under_another_calibration(self):
        recording = copy("k")
        file = recording / "recording.yaml"
        lines = [f"calibration: {'1' * 64}" if line.startswith("calibration:") else line for line in file.read_text().splitlines()]
        file.write_text("\n".join(lines) + "\n")
        self.inspect(recording, says=["calibration", "1" * 16])

    def test_a_recipe_of_another_calibration(self):
        recipe = WORK / "foreign.recipe.yaml"
        lines = [f"calibration_hash: \"{'2' * 64}\"" if line.startswith("calibration_hash:") else line
                 for line in BENCH.recipe.read_text().splitlines()]
        recipe.write_text("\n".join(lines) + "\n")
        self.inspect(copy("l"), "--recipe", recipe, says=["calibration_hash", "2" * 16])

    def test_a_recipe_of_another_basis(self):
        recipe = WORK / "other_basis.recipe.yaml"
        lines = [f"basis_checksum: \"{'3' * 64}\"" if line.startswith("basis_checksum:") else line
                 for line in BENCH.recipe.read_text().splitlines()]
        recipe.write_text("\n".join(lines) + "\n")
        self.inspect(copy("m"), "--recipe", recipe, says=["basis_checksum", "3" * 16, "another basis", "teach again"])

    def test_a_recipe_of_another_station(self):
        station, calibration = BENCH.folder / "other_station.yaml", WORK / "other.calibration.exr"
        station.write_text(BENCH.station.read_text().replace("width: 728", "width: 720"))
        taken = []
        for scene in ("dark", "white", "good"):
            taken.append(BENCH.folder / f"recordings/other_{scene}")
            shutil.rmtree(taken[-1], ignore_errors=True)
            BENCH.json("simulate", "--config", station, "--scene", BENCH.folder / f"scenes/{scene}.yaml", "--out", taken[-1])
        BENCH.json("calibrate", "--config", station, "--from", *taken[:2], "--out", calibration)
        self.refused("inspect", "--config", station, "--calibration", calibration, "--from", taken[2], "--recipe", BENCH.recipe,
                     says=["recipe 'good part'", "calibration_hash", "another calibration", "teach again"])

    def test_a_truncated_calibration(self):
        calibration = WORK / "short.exr"
        shutil.copy(BENCH.calibration, calibration)
        self.inspect(copy("i"), "--calibration", cut(calibration, 0.3), says=["short.exr"])

    def test_a_picture_as_calibration(self):
        png = sorted((BENCH.folder / "recordings/good/part_0001").glob("*.png"))[0]
        self.inspect(copy("j"), "--calibration", png, says=[png.name])

    def test_yaml_mistakes_are_named_by_place_and_path(self):
        text = BENCH.station.read_text()
        for name, old, new, says in (
            ("key", "gain: 1\n", "gian: 1\n", ["gian"]),
            ("type", "bits: 10", "bits: ten", ["camera.sensor.bits"]),
            ("range", "port: 1502", "port: 99999", ["plc.tcp.port", "99999"]),
            ("missing", "  eta:", "  # eta:", ["eta"]),
            ("syntax", "bracket_ms: [", "bracket_ms: [[", []),
        ):
            with self.subTest(name):
                self.assertIn(old, text)
                file = BENCH.folder / f"mistake_{name}.yaml"
                file.write_text(text.replace(old, new, 1))
                self.refused("check", file, says=[f"{file.name}:", *says])

    def test_a_folder_without_recordings(self):
        (WORK / "empty").mkdir(exist_ok=True)
        self.inspect(WORK / "empty", says=["empty"])

    def test_a_command_line_that_is_wrong(self):
        self.refused("inspect", "--no-such-option", says=["command line", "--from"])

    def test_teaching_from_parts_of_two_kinds(self):
        other = BENCH.scene("other", "target: part\nmaterials:\n  - {name: x, lambert: [0.6, 0.1, 0.1]}\n")
        recording = BENCH.simulate(other, "other")
        self.refused("teach", "--config", BENCH.station, "--from", BENCH.folder / "recordings/good/part_0001", recording,
                     "--out", WORK / "two_kinds.yaml", says=["cannot teach", "wrong part"])

    def test_teaching_from_nothing(self):
        (WORK / "nothing").mkdir(exist_ok=True)
        self.refused("teach", "--config", BENCH.station, "--from", WORK / "nothing", "--out", WORK / "none.yaml", says=["nothing"])
        self.refused("teach", "--config", BENCH.station, "--out", WORK / "none.yaml", says=["neither --from nor --live", "good parts"])
        self.assertFalse((WORK / "none.yaml").exists())

    def patched(self, cells):
        """A part with a square patch in its corner, away from light 1's mirror direction; sides in 64ths of the part's."""
        size = 64
        rows = [bytes([0]) + bytes(int(x < cells and y < cells) for x in range(size)) for y in range(size)]
        chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        (BENCH.folder / f"scenes/patch_{cells}.png").write_bytes(
            b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", size, size, 8, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(b"".join(rows))) + chunk(b"IEND", b""))
        scene = BENCH.scene(f"patch_{cells}", f"target: part\nregions: patch_{cells}.png\nmaterials:\n"
                            "  - {name: body, lambert: [0.5, 0.1, 0.1]}\n  - {name: patch, lambert: [0.1, 0.2, 0.6]}\n")
        return BENCH.simulate(scene, f"patch_{cells}")

    def test_a_cluster_too_small_to_see_a_highlight_is_named(self):
        taught = BENCH.json("teach", "--config", BENCH.station, "--from", self.patched(24), "--out", WORK / "patch.yaml")
        self.assertEqual(len(taught["clusters"]), 2, taught)
        warning = [w for w in taught["warnings"] if "highlight" in w]
        self.assertEqual(len(warning), 1, taught["warnings"])
        self.assertIn("cluster 'region 1' is too small or too one-sided to see a highlight", warning[0])

    def test_a_cluster_that_a_move_may_take_out_of_judgement_is_named(self):
        taught = BENCH.json("teach", "--config", BENCH.station, "--from", self.patched(17), "--out", WORK / "small.yaml")
        warning = [w for w in taught["warnings"] if "not judged (coverage)" in w]
        self.assertEqual(len(warning), 1, taught["warnings"])
        self.assertRegex(warning[0], r"cluster 'region 1' was seen in 2\d angular bins and it takes 20 to judge it")
        roomy = BENCH.json("teach", "--config", BENCH.station, "--from", self.patched(40), "--out", WORK / "roomy.yaml")
        self.assertFalse([w for w in roomy["warnings"] if "coverage" in w and "not judged" in w], roomy["warnings"])

    def test_a_cluster_too_small_to_be_judged_is_refused(self):
        self.refused("teach", "--config", BENCH.station, "--from", self.patched(14), "--out", WORK / "none.yaml",
                     says=["cluster 1 covers only", "angular bins; expected 20 or more"])

    def test_teaching_from_an_absent_part(self):
        recording = BENCH.simulate(BENCH.folder / "scenes/absent.yaml", "absent_teach")
        self.refused("teach", "--config", BENCH.station, "--from", recording, "--out", WORK / "none.yaml", says=["teach"])

    def test_a_port_in_use(self):
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            port = str(taken.getsockname()[1])
            done = subprocess.run([str(BENCH.programs / "brdfgated"), "--config", str(BENCH.station), "--port", port,
                                   "--state-dir", str(WORK / "state")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                  timeout=60, check=False)
        self.assertEqual(done.returncode, 2)
        self.assertIn(port, done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
