#!/usr/bin/env python3
"""Hardware backends and the shipped daemon in a guest with a real kernel.    test_lab.py GUEST BUILD

The closed loop: brdfgated under systemd, from its shipped unit, switches LED lines of a gpio-sim chip; lab_bench sees them
and feeds /dev/video40 with the frames that each light gives; a Modbus client on this side of the network reads verdicts.
"""
import contextlib
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

from pymodbus.client import ModbusTcpClient

import lab

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
GUEST, BUILD = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]).resolve()
TOOL = BUILD / "app/brdfgate"
PROGRAMS = [TOOL, BUILD / "app/brdfgated", *(BUILD / "tests" / name for name in ("lab_gpio", "lab_camera", "lab_bench"))]
PASS, REJECT, NOT_JUDGED = 1, 2, 3
HARDWARE = 1 << 12
CAMERA, LIGHTS, TRIGGER_LINE = 10, 11, 12
COMPLETED, FAILED = 1, 4

SENSOR = """sensor: {width: 364, height: 272, bits: 16, mosaic: mono, black_level_dn: 1000, full_well_dn: 64000,
    gain_dn_per_electron: 6.3, read_noise_dn: 10}
  bracket_ms: [2]
  ambient_ms: [2]
"""
DEVICE = """camera:
  backend: v4l2
  device: {path: /dev/video40, pixel_format: Y16, fixed_exposure_ms: 2, timestamp: end_of_frame, readout_ms: 0.1}
  """ + SENSOR + """  gain: 1
  frame_timeout_ms: 20000

lights: {chip: lab-lights, lines: [LED1, LED2], settle_ms: 400, max_on_ms: 60000}
trigger: {chip: lab-machine, line: START, edge: rising, bias: pull_down, debounce_ms: 20}
outputs:
  chip: lab-machine
  pass: {line: PASS}
  reject: {line: REJECT}
  busy: {line: BUSY}

"""


def simulated_station(basis):
    """The shipped station with a small 16-bit mono sensor of one exposure: what a camera without controls can do."""
    text = (ROOT / "config/station.yaml").read_text()
    text = re.sub(r"sensor:\n.*?  ambient_ms: [^\n]*\n", SENSOR, text, flags=re.S)
    text = re.sub(r"fixture: \{albedo: [^}]*\}", "fixture: {albedo: [0.9, 0.9, 0.9], tolerance: 0.1}", text)
    text = text.replace("method: gp", "method: ridge")  # an emulated processor takes half a minute for gp
    text = text.replace("colour: linear_srgb_d65", "colour: none").replace("bind: 127.0.0.1", "bind: 0.0.0.0")
    return re.sub(r"basis: .*", f"basis: {basis}", text)


def hardware_station(text):
    """The same station behind real devices."""
    text = re.sub(r"camera:\n  backend.*?(?=rig:)", DEVICE, text, flags=re.S)
    return re.sub(r"simulator:.*?(?=inspection:)", "", text, flags=re.S)


def prepare(folder):
    """Calibration and recipe from the simulated twin, made here by the shipped tool."""
    shutil.copytree(ROOT / "config/scenes", folder / "scenes")
    station = folder / "sim.yaml"
    station.write_text(simulated_station(ROOT / "config/basis/merl.basis"))

    def tool(*arguments):
        subprocess.run([str(a) for a in (TOOL, *arguments)], check=True, stdout=subprocess.DEVNULL)

    def simulate(scene, parts):
        tool("simulate", "--config", station, "--scene", folder / f"scenes/{scene}.yaml", "--out", folder / scene, "--parts", parts)
        return folder / scene

    tool("calibrate", "--config", station, "--from", simulate("dark", 2), simulate("white", 4), "--out",
         folder / "station.calibration.exr")
    tool("teach", "--config", station, "--from", simulate("good", 10), "--out", folder / "good.recipe.yaml", "--name", "good")


def fill(content, folder):
    """What the guest finds under /lab."""
    for sub in ("bin", "lib", "etc"):
        (content / sub).mkdir(parents=True)
    for program in PROGRAMS:
        subprocess.run(["strip", "-o", str(content / "bin" / program.name), str(program)], check=True)
    present = set((GUEST / "libraries.txt").read_text().split())
    for name, path in lab.libraries_for(PROGRAMS, present).items():
        shutil.copy(path, content / "lib" / name)
    twin = simulated_station("/lab/etc/merl.basis")
    (content / "etc/sim.yaml").write_text(twin)
    station = hardware_station(twin)
    (content / "etc/station.yaml").write_text(station.replace("recipes: []", "recipes: [good.recipe.yaml]"))
    for file in (ROOT / "config/basis/merl.basis", folder / "station.calibration.exr", folder / "good.recipe.yaml",
                 ROOT / "systemd/brdfgated.service", ROOT / "systemd/60-brdfgate.rules", ROOT / "systemd/brdfgate.sysusers.conf"):
        shutil.copy(file, content / "etc")
    shutil.copytree(ROOT / "config/scenes", content / "etc/scenes")


SET_UP = r"""set -e
echo /lab/lib >/etc/ld.so.conf.d/lab.conf; ldconfig
install -m 644 /lab/etc/60-brdfgate.rules /etc/udev/rules.d/
install -m 644 /lab/etc/brdfgate.sysusers.conf /etc/sysusers.d/brdfgate.conf 2>/dev/null ||
  install -D -m 644 /lab/etc/brdfgate.sysusers.conf /etc/sysusers.d/brdfgate.conf
systemd-sysusers
udevadm control --reload
modprobe configfs; mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config
modprobe gpio-sim
modprobe v4l2loopback video_nr=40 card_label=lab exclusive_caps=0
modprobe vivid node_types=0x1 n_devs=1
udevadm settle
"""

CHIPS = r"""set -e
chip() { # chip LABEL NAME...
  local label=$1 dir=/sys/kernel/config/gpio-sim/$1 n=0
  shift
  mkdir -p $dir/bank0
  echo 8 >$dir/bank0/num_lines; echo $label >$dir/bank0/label
  for name in "$@"; do mkdir -p $dir/bank0/line$n; echo $name >$dir/bank0/line$n/name; n=$((n+1)); done
  echo 1 >$dir/live
}
chip lab-lights LED1 LED2
chip lab-machine START PASS REJECT BUSY
udevadm settle
mkdir -p /run/lab
"""

# Where a line's level can be seen, wherever the chip is.
LEVEL = r"""level() { local d=/sys/kernel/config/gpio-sim/$1; cat /sys/devices/platform/$(cat $d/dev_name)/$(cat $d/bank0/chip_name)/sim_gpio$2/$3; }
pull() { local d=/sys/kernel/config/gpio-sim/$1; echo $3 >/sys/devices/platform/$(cat $d/dev_name)/$(cat $d/bank0/chip_name)/sim_gpio$2/pull; }
"""

SERVICE = r"""set -e
ln -sf /lab/bin/brdfgate /lab/bin/brdfgated /usr/bin/
mkdir -p /etc/brdfgate; cp /lab/etc/* /etc/brdfgate/ 2>/dev/null || true
cp -r /lab/etc/scenes /etc/brdfgate/
cp /lab/etc/brdfgated.service /etc/systemd/system/
d=/sys/kernel/config/gpio-sim/lab-lights
s=/sys/devices/platform/$(cat $d/dev_name)/$(cat $d/bank0/chip_name)
echo "scene /lab/etc/scenes/good.yaml" >/run/lab/orders
systemctl daemon-reload
systemd-run --unit=lab-bench /lab/bin/lab_bench /lab/etc/sim.yaml /dev/video40 $s/sim_gpio0/value $s/sim_gpio1/value /run/lab/orders
for i in $(seq 600); do journalctl -u lab-bench | grep -q feeding && break; sleep 0.2; done
systemctl start brdfgated
"""


class Plc:
    """A PLC by an independent Modbus library."""

    def __init__(self, port):
        self.port = port
        self.client = None
        self.connect()

    def connect(self, limit=240):
        deadline = time.monotonic() + limit
        while time.monotonic() < deadline:
            client = ModbusTcpClient("127.0.0.1", port=self.port, timeout=20)
            if client.connect():
                answer = client.read_input_registers(0, 2)
                if not answer.isError() and answer.registers == [0x4252, 0x4446]:
                    self.client = client
                    return
            client.close()
            time.sleep(0.5)
        raise AssertionError("no Modbus server")

    def words(self, address, count):
        answer = self.client.read_input_registers(address, count)
        if answer.isError():
            raise AssertionError(f"read of {address}: {answer}")
        return answer.registers

    def command(self, *values):
        answer = self.client.write_registers(1000, list(values))
        if answer.isError():
            raise AssertionError(f"write of {values}: {answer}")

    def await_bits(self, bits, limit=240):
        deadline = time.monotonic() + limit
        while time.monotonic() < deadline:
            if self.words(4, 1)[0] & bits == bits:
                return
            time.sleep(0.1)
        raise AssertionError(f"status {self.words(3, 4)} never had {bits:#x}")

    def result(self):
        """Waits for the result, reads and acknowledges it."""
        self.await_bits(1 << 4)
        words = self.words(100, 26)
        self.command(1 | 4)
        self.command(1)
        return {"trigger_id": words[2] << 16 | words[3], "state": words[6], "verdict": words[7], "reasons": words[8],
                "error": self.words(6, 1)[0], "status": self.words(4, 1)[0]}

    def inspect(self, trigger_id):
        self.command(1 | 8, trigger_id >> 16, trigger_id & 0xFFFF)  # a clear_error with it
        self.await_bits(1)
        self.command(1 | 2)
        return self.result()


class LabTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="brdfgate-lab."))
        prepare(cls.folder)
        fill(cls.folder / "content", cls.folder)
        lab.make_payload(cls.folder / "payload.img", cls.folder / "content")
        cls.port = lab.free_port()
        cls.guest = lab.Guest(GUEST, cls.folder / "payload.img", cls.folder / "console.log", [(cls.port, 1502)])
        cls.guest.wait()
        cls.guest.must(SET_UP)

    @classmethod
    def tearDownClass(cls):
        cls.guest.stop()
        shutil.rmtree(cls.folder)

    # --- the contracts, on real drivers ---------------------------------------------------------

    def contract(self, program):
        code, text = self.guest.run(f"cd /lab && timeout 900 bin/{program}", limit=960)
        self.assertEqual(code, 0, text[-4000:])
        print(f"{program}: {text.strip().splitlines()[-1]}", file=sys.stderr)

    def test_1_lights_trigger_and_outputs_on_gpio_sim(self):
        self.contract("lab_gpio")

    def test_1_v4l2_camera_on_vivid_and_loopback(self):
        self.contract("lab_camera")

    # --- the closed loop ------------------------------------------------------------------------

    def level(self, chip, line, what="value"):
        return self.guest.must(f"{LEVEL} level {chip} {line} {what}").strip()

    def pull(self, chip, line, how):
        self.guest.must(f"{LEVEL} pull {chip} {line} {how}")

    def orders(self, *lines):
        text = "\\n".join(lines)
        self.guest.must(f"printf '{text}\\n' >/run/lab/orders.new && mv /run/lab/orders.new /run/lab/orders; sleep 1")

    def put(self, scene, *more):
        self.orders(f"scene /lab/etc/scenes/{scene}.yaml", *more)

    def assert_dark(self):
        self.assertEqual([self.level("lab-lights", 0), self.level("lab-lights", 1)], ["0", "0"])

    def assert_lights_fault(self, result):
        self.assertEqual((result["verdict"], result["reasons"], result["state"], result["error"]),
                         (NOT_JUDGED, HARDWARE, FAILED, LIGHTS), self.journal())
        self.assert_dark()

    def journal(self):
        return self.guest.run("journalctl -u brdfgated -u lab-bench --no-pager | tail -n 25; systemctl status brdfgated | head -12")[1]

    @contextlib.contextmanager
    def loop(self):
        """The running station; started once, checked and mended between tests."""
        if not getattr(type(self), "running", False):
            self.guest.must(CHIPS)
            self.guest.must(SERVICE, limit=400)
            type(self).running = True
        self.put("good")
        plc = Plc(self.port)
        try:
            yield plc
        finally:
            plc.client.close()

    def test_2_good_passes_and_bad_is_rejected(self):
        with self.loop() as plc:
            good = plc.inspect(70001)
            self.assertEqual((good["verdict"], good["state"], good["trigger_id"]), (PASS, COMPLETED, 70001), self.journal())
            self.assertEqual(good["status"] & 1 << 12, 0, "not simulated")
            self.put("bad_gloss")
            bad = plc.inspect(2)
            self.assertEqual((bad["verdict"], bad["reasons"] & 1), (REJECT, 1), self.journal())
            self.assert_dark()

    def test_3_the_machines_trigger_line_and_verdict_lines(self):
        with self.loop() as plc:
            plc.command(0, 0, 77)
            self.assertEqual(self.level("lab-machine", 3), "1", "busy: nothing is taken while triggers are not enabled")
            missed = plc.words(48, 2)[1]
            self.pull("lab-machine", 0, "pull-up")
            self.guest.must("sleep 1")
            self.pull("lab-machine", 0, "pull-down")
            self.assertEqual(plc.words(48, 2)[1], missed + 1)
            plc.command(1 | 8)
            plc.await_bits(1)
            self.assertEqual(self.level("lab-machine", 3), "0")
            self.pull("lab-machine", 0, "pull-up")
            plc.await_bits(1 << 4)
            self.assertEqual([self.level("lab-machine", n) for n in (1, 2)], ["1", "0"], self.journal())
            self.pull("lab-machine", 0, "pull-down")
            result = plc.result()
            self.assertEqual((result["trigger_id"], result["verdict"]), (77, PASS))
            self.put("bad_gloss")
            plc.command(1 | 2)
            plc.await_bits(1 << 4)
            self.assertEqual([self.level("lab-machine", n) for n in (1, 2)], ["0", "1"])
            plc.result()

    def test_4_a_led_that_stays_dark_or_on(self):
        with self.loop() as plc:
            for n, order in enumerate(("dead 1", "dead 2", "stuck 1", "stuck 2")):
                with self.subTest(order):
                    self.put("good", order)
                    self.assert_lights_fault(plc.inspect(100 + n))
            self.put("good")
            self.assertEqual(plc.inspect(109)["verdict"], PASS, self.journal())

    def test_5_a_camera_that_falls_silent_and_returns(self):
        with self.loop() as plc:
            self.put("good", "silent")
            silent = plc.inspect(150)
            self.assertEqual((silent["verdict"], silent["reasons"], silent["error"]), (NOT_JUDGED, HARDWARE, CAMERA), self.journal())
            self.assert_dark()
            self.put("good")
            self.assertEqual(plc.inspect(151)["verdict"], PASS, self.journal())

    def test_5_a_chip_that_disappears_and_returns(self):
        with self.loop() as plc:
            self.guest.must("echo 0 >/sys/kernel/config/gpio-sim/lab-lights/live")
            gone = plc.inspect(200)
            self.assertEqual((gone["verdict"], gone["reasons"], gone["error"]), (NOT_JUDGED, HARDWARE, LIGHTS), self.journal())
            self.guest.must("echo 1 >/sys/kernel/config/gpio-sim/lab-lights/live; udevadm settle")
            self.rewire()
            self.assertEqual(plc.inspect(201)["verdict"], PASS, self.journal())
            self.guest.must("echo 0 >/sys/kernel/config/gpio-sim/lab-machine/live")
            plc.await_bits(1 << 8)
            deadline = time.monotonic() + 60
            while plc.words(3, 1)[0] != 2 and time.monotonic() < deadline:
                time.sleep(0.2)
            self.assertEqual((plc.words(3, 1)[0], plc.words(6, 1)[0]), (2, TRIGGER_LINE), self.journal())
            self.guest.must("echo 1 >/sys/kernel/config/gpio-sim/lab-machine/live; udevadm settle")
            self.assertEqual(plc.inspect(202)["verdict"], PASS, self.journal())

    def rewire(self):
        """The bench's eyes follow the chip, whose place in sysfs has moved."""
        script = SERVICE.split("systemctl daemon-reload")[1].split("systemctl start brdfgated")[0]
        self.guest.must("systemctl stop lab-bench 2>/dev/null; systemctl reset-failed lab-bench 2>/dev/null;"
                        "d=/sys/kernel/config/gpio-sim/lab-lights; s=/sys/devices/platform/$(cat $d/dev_name)/$(cat $d/bank0/chip_name)\n"
                        + script, limit=400)

    def test_6_a_line_that_another_program_holds(self):
        with self.loop() as plc:
            self.guest.must("systemctl stop brdfgated; systemd-run --unit=thief gpioset --mode=signal $(gpiofind LED2)=0; sleep 1;"
                            "systemctl start brdfgated")
            plc.client.close()
            plc.connect()
            self.assert_lights_fault(plc.inspect(300))
            self.guest.must("systemctl stop thief")
            self.assertEqual(plc.inspect(301)["verdict"], PASS, self.journal())

    def test_7_a_clock_that_steps_by_a_year(self):
        with self.loop() as plc:
            for step in ("+1 year", "-2 years"):
                self.guest.must(f"date -s \"$(date -d '{step}')\"")
                self.assertEqual(plc.inspect(400)["verdict"], PASS, self.journal())

    def burning(self, plc):
        """An inspection under way, with a light on."""
        plc.command(1 | 8, 0, 500)
        plc.await_bits(1)
        plc.command(1 | 2)
        self.guest.must(f"{LEVEL} for i in $(seq 2000); do [ $(level lab-lights 1 value) = 1 ] && exit 0; done; exit 1")

    def test_8_killed_or_hung_the_lights_go_off_and_the_station_comes_back(self):
        with self.loop() as plc:
            for how in ("KILL", "STOP"):
                with self.subTest(how):
                    self.burning(plc)
                    self.guest.must(f"systemctl kill -s {how} --kill-whom=main brdfgated")
                    self.guest.must(f"{LEVEL} for i in $(seq 1000); do [ $(level lab-lights 1 value) = 0 ] && exit 0; sleep 0.1; done; exit 1")
                    self.assert_dark()
                    plc.client.close()
                    plc.connect()
                    self.assertEqual(plc.words(107, 1)[0], 0, "nothing reads as pass")
                    self.assertEqual(plc.inspect(501)["verdict"], PASS, self.journal())
            self.assertIn("watchdog", self.guest.must("journalctl -u brdfgated --no-pager"))

    def test_9_lights_as_the_camera_sees_them(self):
        with self.loop() as plc:
            plc.client.close()
            self.guest.must("systemctl stop brdfgated")
            code, text = self.guest.run("brdfgate check --lights --json /etc/brdfgate/station.yaml", limit=400)
            self.assertEqual(code, 0, text)
            lights = json.loads(text)["lights"]
            self.assertEqual([light["seen"] for light in lights], [True, True])
            self.put("good", "dead 2")
            code, text = self.guest.run("brdfgate check --lights --json /etc/brdfgate/station.yaml", limit=400)
            self.assertEqual((code, [light["seen"] for light in json.loads(text)["lights"]]), (1, [True, False]), text)
            self.assertEqual(self.guest.run("brdfgate lights --off --config /etc/brdfgate/station.yaml")[0], 0)
            self.assert_dark()


class Tally(unittest.TextTestResult):
    passed = 0

    def addSuccess(self, test):
        super().addSuccess(test)
        self.passed += 1


if __name__ == "__main__":
    outcome = unittest.TextTestRunner(verbosity=2, resultclass=Tally).run(unittest.defaultTestLoader.loadTestsFromTestCase(LabTest))
    failed = len({str(test).split(" (")[0] for test, _ in outcome.failures + outcome.errors})
    print(f"kernel lab: {outcome.passed} passed, {failed} failed")
    sys.exit(0 if outcome.wasSuccessful() and outcome.passed > 0 else 1)
