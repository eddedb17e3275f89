#!/usr/bin/env python3
"""Hardware backends and the shipped daemon in a guest with a real kernel.    test_lab.py GUEST BUILD [TEST...]

The closed loop: brdfgated under systemd, from its shipped unit, switches LED lines of a gpio-sim chip; lab_bench sees them
and feeds /dev/video40, or a USB camera of its own, with the frames that each light gives; a Modbus client on this side of the
network reads verdicts.
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
from pymodbus.exceptions import ModbusException

import lab

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
GUEST, BUILD = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]).resolve()
TOOL = BUILD / "app/brdfgate"
PROGRAMS = [TOOL, BUILD / "app/brdfgated", *(BUILD / "tests" / name for name in ("camera_contract", "lab_gpio", "lab_camera", "lab_bench"))]
PASS, REJECT, NOT_JUDGED = 1, 2, 3
HARDWARE = 1 << 12
CAMERA, LIGHTS, TRIGGER_LINE, ABSENT, IMPLAUSIBLE = 10, 11, 12, 13, 16
COMPLETED, FAILED = 1, 4
ERROR = 2

SENSOR = """sensor: {width: 364, height: 272, bits: 16, mosaic: mono, black_level_dn: 1000, full_well_dn: 64000,
    gain_dn_per_electron: 6.3, read_noise_dn: 10}
  bracket_ms: [2]
  ambient_ms: [2]
"""
# A USB camera of lab_bench: uvcvideo counts its exposures in 0.1 ms. It obeys a setting a frame late, and its frames
# are stamped when they arrive.
USB = "/dev/v4l/by-id/usb-brdfgate_lab_camera_1-video-index0"
USB_CAMERA = f"""camera:
  backend: v4l2
  device: {{path: {USB}, pixel_format: Y16, control_delay_frames: 3, timestamp: end_of_frame, readout_ms: 0.1,
    gain: {{law: linear, code_at_1: 16}}}}
  """ + SENSOR.replace("bracket_ms: [2]", "bracket_ms: [0.5, 2, 8]").replace("ambient_ms: [2]", "ambient_ms: [8]") + """  gain: 1
  frame_timeout_ms: 30000

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


def contract_camera(backend, device, width, height, bits):
    """A camera without controls, for the camera contract."""
    return f"""camera:
  backend: {backend}
  device: {{{device}, fixed_exposure_ms: 2}}
  sensor: {{width: {width}, height: {height}, bits: {bits}, mosaic: mono, black_level_dn: 0, full_well_dn: {2 ** bits - 1},
    gain_dn_per_electron: 1, read_noise_dn: 1}}
  bracket_ms: [2]
  ambient_ms: [2]
  gain: 1
  frame_timeout_ms: 30000

lights: {{chip: lab-lights, lines: [LED1, LED2]}}

"""


CONTRACT_CAMERAS = {
    "vivid": contract_camera("v4l2", "path: /dev/video10, pixel_format: GREY", 320, 180, 8),
    "loopback": contract_camera("v4l2", "path: /dev/video40, pixel_format: Y16, timestamp: end_of_frame, readout_ms: 0.1", 364, 272, 16),
    # libcamera's vimc gives no raw stream: the backend is handed the green channel of what it has.
    "vimc": contract_camera("libcamera", "pixel_format: RGB24, line_time_us: 20", 192, 144, 8),
}


CONTRACT_CAMERAS["usb"] = USB_CAMERA + """lights: {chip: lab-lights, lines: [LED1, LED2]}

"""


def simulated_station(basis):
    """The shipped station with a small 16-bit mono sensor of one exposure: what a camera without controls can do."""
    text = (ROOT / "config/station.yaml").read_text()
    text = re.sub(r"sensor:\n.*?  ambient_ms: [^\n]*\n", SENSOR, text, flags=re.S)
    text = re.sub(r"line_time_us: [\d.]+", "line_time_us: 10", text)  # the exposure is a whole number of them
    text = re.sub(r"handshake_timeout_s: \d+", "handshake_timeout_s: 120", text)
    text = re.sub(r"fixture: \{albedo: [^}]*\}", "fixture: {albedo: [0.9, 0.9, 0.9], tolerance: 0.1}", text)
    text = text.replace("method: gp", "method: ridge")  # an emulated processor takes half a minute for gp
    text = text.replace("colour: linear_srgb_d65", "colour: none").replace("bind: 127.0.0.1", "bind: 0.0.0.0")
    return re.sub(r"basis: .*", f"basis: {basis}", text)


def hardware_station(text, devices=DEVICE):
    """The same station behind real devices."""
    text = re.sub(r"camera:\n  backend.*?(?=rig:)", devices, text, flags=re.S)
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
    station = station.replace("recipes: []", "recipes: [good.recipe.yaml]")
    (content / "etc/station.yaml").write_text(station)
    (content / "etc/usb-station.yaml").write_text(re.sub(r"camera:\n  backend.*?\n\n", lambda _: USB_CAMERA, station, count=1, flags=re.S))
    for name, camera in CONTRACT_CAMERAS.items():
        (content / f"etc/{name}.yaml").write_text(hardware_station(twin, camera))
    for file in (ROOT / "config/basis/merl.basis", folder / "station.calibration.exr", folder / "good.recipe.yaml",
                 ROOT / "systemd/brdfgated.service", ROOT / "systemd/60-brdfgate.rules", ROOT / "systemd/brdfgate.sysusers.conf"):
        shutil.copy(file, content / "etc")
    shutil.copytree(ROOT / "config/scenes", content / "etc/scenes")


LOOPBACK = "modprobe v4l2loopback video_nr=40 card_label=lab exclusive_caps=0\n"

SET_UP = rf"""set -e
echo /lab/lib >/etc/ld.so.conf.d/lab.conf; ldconfig
install -m 644 /lab/etc/60-brdfgate.rules /etc/udev/rules.d/
install -m 644 /lab/etc/brdfgate.sysusers.conf /etc/sysusers.d/brdfgate.conf 2>/dev/null ||
  install -D -m 644 /lab/etc/brdfgate.sysusers.conf /etc/sysusers.d/brdfgate.conf
systemd-sysusers
udevadm control --reload
modprobe configfs; mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config
modprobe gpio-sim
{LOOPBACK}modprobe vivid node_types=0x1 n_devs=1 vid_cap_nr=10
modprobe vimc
modprobe vhci-hcd
modprobe uvcvideo
udevadm settle
mkdir -p /run/lab
printf "scene /lab/etc/scenes/good.yaml\nnumber 0\n" >/run/lab/orders
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
"""

# Where a line's level can be seen, wherever the chip is.
LEVEL = r"""level() { local d=/sys/kernel/config/gpio-sim/$1; cat /sys/devices/platform/$(cat $d/dev_name)/$(cat $d/bank0/chip_name)/sim_gpio$2/$3; }
pull() { local d=/sys/kernel/config/gpio-sim/$1; echo $3 >/sys/devices/platform/$(cat $d/dev_name)/$(cat $d/bank0/chip_name)/sim_gpio$2/pull; }
await() { local i; for i in $(seq 1200); do eval "$1" && return 0; sleep 0.1; done; echo "never: $1"; return 1; }
"""

# lab_bench on the loopback or as a USB camera, looking at two files that hold the lights' levels.
FEED = r"""set -e
feed() { # feed LINE1 LINE2 [VIDEO]
  systemctl stop lab-bench 2>/dev/null || true
  systemctl reset-failed lab-bench 2>/dev/null || true
  rm -f /run/lab/orders.done
  systemd-run --unit=lab-bench /lab/bin/lab_bench /lab/etc/sim.yaml ${3:-/dev/video40} $1 $2 /run/lab/orders
  await '[ -e /run/lab/orders.done ]'
}
feed_of_the_chip() { # feed_of_the_chip [VIDEO]
  local d=/sys/kernel/config/gpio-sim/lab-lights
  local s=/sys/devices/platform/$(cat $d/dev_name)/$(cat $d/bank0/chip_name)
  feed $s/sim_gpio0/value $s/sim_gpio1/value $1
}
"""

# The USB camera's cable: "cable out" and "cable in" return when the kernel has seen it.
CABLE = f"""{LEVEL}
case $1 in
  out) printf 'scene /lab/etc/scenes/good.yaml\\nunplugged\\nnumber 0\\n' >/run/lab/orders.new; gone=! ;;
  in) printf 'scene /lab/etc/scenes/good.yaml\\nnumber 0\\n' >/run/lab/orders.new; gone= ;;
esac
mv /run/lab/orders.new /run/lab/orders
await "[ $gone -e {USB} ]"
"""

# The shipped unit; its watchdog three times as patient, as an emulated processor is slow.
SERVICE = r"""set -e
ln -sf /lab/bin/brdfgate /lab/bin/brdfgated /usr/bin/
mkdir -p /etc/brdfgate /etc/systemd/system/brdfgated.service.d
cp /lab/etc/*.* /etc/brdfgate/
cp -r /lab/etc/scenes /etc/brdfgate/
cp /lab/etc/brdfgated.service /etc/systemd/system/
printf '[Service]\nWatchdogSec=30\n' >/etc/systemd/system/brdfgated.service.d/lab.conf
systemctl daemon-reload
feed_of_the_chip
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
            # The port is forwarded by QEMU, which takes connections before anybody listens behind it.
            with contextlib.suppress(ModbusException, OSError):
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

    def until(self, holds, what, limit=240):
        deadline = time.monotonic() + limit
        while not holds():
            if time.monotonic() > deadline:
                raise AssertionError(f"never {what}: state, status, error {self.words(3, 4)}")
            time.sleep(0.1)

    def await_bits(self, bits):
        self.until(lambda: self.words(4, 1)[0] & bits == bits, f"status bits {bits:#x}")

    def result(self):
        """Waits for the result, reads and acknowledges it."""
        self.await_bits(1 << 4)
        words = self.words(100, 26)
        self.command(1 | 4)
        self.until(lambda: not self.words(4, 1)[0] & 1 << 4, "acknowledged")
        self.command(1)
        return {"trigger_id": words[2] << 16 | words[3], "state": words[6], "verdict": words[7], "reasons": words[8],
                "error": self.words(6, 1)[0], "status": self.words(4, 1)[0]}

    def inspect(self, trigger_id):
        self.command(1 | 8, trigger_id >> 16, trigger_id & 0xFFFF)  # a clear_error with it
        self.await_bits(1)
        self.command(1 | 2)
        return self.result()


class LabTest(unittest.TestCase):
    order = 0
    running = False

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

    def test_x_the_kernel_took_no_harm(self):
        """Last of all: use after free in a driver shows anywhere, so it is named here."""
        _, text = self.guest.run("dmesg | grep -A 30 -E 'BUG: (unable|kernel)|general protection|Oops:|WARNING: CPU' | head -60")
        self.assertEqual(text.strip(), "", "the guest's kernel complains")

    # --- the contracts, on real drivers ---------------------------------------------------------

    def contract(self, program, environment=""):
        code, text = self.guest.run(f"cd /lab && {environment} timeout 900 bin/{program}", limit=960)
        if code != 0:
            self.fail(text[-6000:] + self.guest.run("journalctl -u lab-bench --no-pager | tail -n 5; dmesg | tail -n 30")[1])
        print(f"\n  {program}: {text.strip().splitlines()[-1]}", file=sys.stderr)

    def camera_contract(self, camera, environment=""):
        self.contract(f"camera_contract etc/{camera}.yaml", f"BRDFGATE_CYCLES=25 {environment}")

    def test_1_lights_trigger_and_outputs_on_gpio_sim(self):
        self.contract("lab_gpio")

    def test_1_v4l2_counts_come_as_they_were_written(self):
        self.contract("lab_camera")

    def test_1_v4l2_camera_on_vivid(self):
        driver = "/sys/bus/platform/drivers/vivid"
        self.camera_contract("vivid", f"BRDFGATE_UNPLUG='echo vivid.0 >{driver}/unbind' BRDFGATE_REPLUG='echo vivid.0 >{driver}/bind; "
                             "udevadm settle; test -e /dev/video10'")

    def test_1_v4l2_camera_on_loopback(self):
        self.guest.must(f"{LEVEL}{FEED} feed /dev/null /dev/null")
        self.camera_contract("loopback")
        self.guest.must("systemctl stop lab-bench")

    def test_1_v4l2_camera_on_usb(self):
        """uvcvideo's: the one driver here with exposure and gain, and a cable to pull."""
        self.guest.must(f"{LEVEL}{FEED} feed /dev/null /dev/null usb; await '[ -e {USB} ]'")
        self.guest.must(f"cat >/run/lab/cable <<'END'\n{CABLE}END\nchmod +x /run/lab/cable")
        self.camera_contract("usb", "BRDFGATE_UNPLUG='sh /run/lab/cable out' BRDFGATE_REPLUG='sh /run/lab/cable in'")
        self.guest.must("systemctl stop lab-bench")

    def test_1_libcamera_on_vimc(self):
        self.camera_contract("vimc")

    # --- the closed loop ------------------------------------------------------------------------

    def level(self, chip, line):
        return self.guest.must(f"{LEVEL} level {chip} {line} value").strip()

    def await_machine(self, **levels):
        """Until the lines to the machine have these levels."""
        lines = {"PASS": 1, "REJECT": 2, "BUSY": 3}
        seen = "".join(f"$(level lab-machine {lines[name]} value)" for name in levels)
        self.guest.must(f"{LEVEL} await '[ {seen} = {''.join(levels.values())} ]'")

    def pull(self, how):
        """The machine's trigger line."""
        self.guest.must(f"{LEVEL} pull lab-machine 0 {how}")

    def orders(self, *lines):
        """Waits until the bench obeys."""
        type(self).order += 1
        text = "\\n".join([*lines, f"number {self.order}"])
        self.guest.must(f"{LEVEL} printf '{text}\\n' >/run/lab/orders.new && mv /run/lab/orders.new /run/lab/orders &&"
                        f"await '[ \"$(cat /run/lab/orders.done)\" = {self.order} ]'")

    def put(self, scene, *more):
        self.orders(f"scene /lab/etc/scenes/{scene}.yaml", *more)

    def assert_dark(self):
        self.assertEqual([self.level("lab-lights", 0), self.level("lab-lights", 1)], ["0", "0"])

    def assert_lights_fault(self, result):
        self.assertEqual((result["verdict"], result["reasons"], result["state"], result["error"]),
                         (NOT_JUDGED, HARDWARE, FAILED, LIGHTS), self.journal())
        self.assert_dark()

    def journal(self):
        return self.guest.run("journalctl -u brdfgated -u lab-bench --no-pager | tail -n 25; systemctl status brdfgated | head -12;"
                              "dmesg | grep -E 'BUG: (unable|kernel)|general protection|WARNING: CPU' | tail -n 5")[1]

    @contextlib.contextmanager
    def loop(self):
        """The running station; started once, checked and mended between tests."""
        if not self.running:
            self.guest.must(CHIPS)
            self.guest.must(LEVEL + FEED + SERVICE, limit=400)
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
            self.await_machine(BUSY="1")  # nothing is taken while triggers are not enabled
            missed = plc.words(48, 2)[1]
            self.pull("pull-up")
            plc.until(lambda: plc.words(48, 2)[1] != missed, "a missed trigger")
            self.assertEqual(plc.words(48, 2)[1], missed + 1)
            self.pull("pull-down")
            plc.command(1 | 8)
            plc.await_bits(1)
            self.await_machine(BUSY="0")
            self.pull("pull-up")
            plc.await_bits(1 << 4)
            self.await_machine(PASS="1", REJECT="0")
            self.pull("pull-down")
            result = plc.result()
            self.assertEqual((result["trigger_id"], result["verdict"]), (77, PASS))
            self.put("bad_gloss")
            plc.await_bits(1)
            plc.command(1 | 2)
            plc.await_bits(1 << 4)
            self.await_machine(PASS="0", REJECT="1")
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

    def test_5_a_camera_that_is_absent_at_the_start(self):
        with self.loop() as plc:
            self.guest.must(f"{LEVEL} systemctl stop brdfgated lab-bench; await 'rmmod v4l2loopback' && systemctl start brdfgated")
            plc.client.close()
            plc.connect()
            plc.command(1, 0, 170)
            plc.until(lambda: plc.words(3, 1)[0] == ERROR, "in error")
            self.assertEqual(plc.words(6, 1)[0], ABSENT, self.journal())
            self.assertEqual(plc.words(4, 1)[0] & 1, 0, "not ready")
            self.assert_dark()
            self.guest.must(f"{LEVEL}{FEED}{LOOPBACK} udevadm settle; feed_of_the_chip", limit=400)
            plc.until(lambda: plc.words(3, 1)[0] != ERROR, "taken into use without a restart")
            self.assertEqual(plc.inspect(171)["verdict"], PASS, self.journal())

    def test_5_a_chip_that_disappears_and_returns(self):
        with self.loop() as plc:
            self.inspect_until_light_2_burns(plc, 200)
            self.guest.must("echo 0 >/sys/kernel/config/gpio-sim/lab-lights/live")
            gone = plc.result()
            self.assertEqual((gone["verdict"], gone["reasons"], gone["error"]), (NOT_JUDGED, HARDWARE, LIGHTS), self.journal())
            plc.until(lambda: plc.words(3, 1)[0] == ERROR, "in error")
            self.guest.must(f"{LEVEL}{FEED} echo 1 >/sys/kernel/config/gpio-sim/lab-lights/live; udevadm settle; feed_of_the_chip", limit=400)
            self.put("good")
            plc.until(lambda: plc.words(3, 1)[0] != ERROR, "taken into use without a restart")
            self.assertEqual(plc.inspect(201)["verdict"], PASS, self.journal())
            self.guest.must("echo 0 >/sys/kernel/config/gpio-sim/lab-machine/live")
            plc.await_bits(1 << 8)
            plc.until(lambda: plc.words(3, 1)[0] == ERROR, "in error")
            self.assertEqual(plc.words(6, 1)[0], TRIGGER_LINE, self.journal())
            self.guest.must("echo 1 >/sys/kernel/config/gpio-sim/lab-machine/live; udevadm settle")
            self.assertEqual(plc.inspect(202)["verdict"], PASS, self.journal())

    def test_6_a_line_that_another_program_holds(self):
        with self.loop() as plc:
            self.guest.must(f"{LEVEL} systemctl stop brdfgated; systemd-run --unit=thief gpioset --mode=signal $(gpiofind LED2)=0;"
                            "await 'gpioinfo lab-lights | grep LED2 | grep -q gpioset'; systemctl start brdfgated")
            plc.client.close()
            plc.connect()
            plc.command(1, 0, 300)
            plc.until(lambda: plc.words(3, 1)[0] == ERROR, "in error")
            self.assertEqual((plc.words(6, 1)[0], plc.words(4, 1)[0] & 1), (LIGHTS, 0), self.journal())
            self.assert_dark()
            self.guest.must("systemctl stop thief")
            plc.until(lambda: plc.words(3, 1)[0] != ERROR, "taken into use without a restart")
            self.assertEqual(plc.inspect(301)["verdict"], PASS, self.journal())

    def test_7_a_clock_that_steps_by_a_year(self):
        with self.loop() as plc:
            for step in ("+1 year", "-2 years"):
                self.guest.must(f"date -s \"$(date -d '{step}')\"")
                self.assertEqual(plc.inspect(400)["verdict"], PASS, self.journal())

    def inspect_until_light_2_burns(self, plc, trigger_id):
        """An inspection that waits for a frame, with light 2 on."""
        self.put("good", "mute 2")
        plc.command(1 | 8, 0, trigger_id)
        plc.await_bits(1)
        plc.command(1 | 2)
        self.guest.must(f"{LEVEL} await '[ $(level lab-lights 1 value) = 1 ]'")

    def end_while_it_burns(self, plc, how):
        """A signal to the daemon while a light burns, which then goes off."""
        self.inspect_until_light_2_burns(plc, 500)
        self.guest.must(f"{LEVEL} systemctl kill -s {how} --kill-whom=main brdfgated; await '[ $(level lab-lights 1 value) = 0 ]'")
        self.assert_dark()

    def test_8_killed_or_hung_the_lights_go_off_and_the_station_comes_back(self):
        with self.loop() as plc:
            for how, result in (("KILL", "signal"), ("STOP", "watchdog")):
                with self.subTest(how):
                    self.end_while_it_burns(plc, how)
                    plc.client.close()
                    plc.connect()
                    self.assertEqual(plc.words(107, 1)[0], 0, "nothing reads as pass")
                    self.put("good")
                    self.assertEqual(plc.inspect(501)["verdict"], PASS, self.journal())
                    self.assertIn(f"Failed with result '{result}'", self.guest.must("journalctl -u brdfgated --no-pager"))

    def test_9_lights_as_the_camera_sees_them(self):
        with self.loop() as plc:
            plc.client.close()
            self.guest.must("systemctl stop brdfgated")
            code, text = self.guest.run("brdfgate check --lights --json /etc/brdfgate/station.yaml 2>/run/lab/notes", limit=400)
            self.assertEqual(code, 0, text)
            lights = json.loads(text)["lights"]
            self.assertEqual([light["seen"] for light in lights], [True, True])
            self.put("good", "dead 2")
            code, text = self.guest.run("brdfgate check --lights --json /etc/brdfgate/station.yaml 2>/run/lab/notes", limit=400)
            self.assertEqual((code, [light["seen"] for light in json.loads(text)["lights"]]), (1, [True, False]), text)
            self.assertEqual(self.guest.run("brdfgate lights --off --config /etc/brdfgate/station.yaml")[0], 0)
            self.assert_dark()


    @contextlib.contextmanager
    def usb_loop(self):
        """The station with the USB camera; the loopback's is back afterwards."""
        with self.loop() as plc:
            plc.client.close()
            self.guest.must(f"{LEVEL}{FEED} systemctl stop brdfgated; cp /lab/etc/usb-station.yaml /etc/brdfgate/station.yaml;"
                            f"feed_of_the_chip usb; await '[ -e {USB} ]'; systemctl start brdfgated", limit=400)
            plc.connect()
            try:
                yield plc
            finally:
                self.guest.must(f"{LEVEL}{FEED} systemctl stop brdfgated; cp /lab/etc/station.yaml /etc/brdfgate/; feed_of_the_chip;"
                                "systemctl start brdfgated", limit=400)

    def test_9_a_usb_camera_with_brackets(self):
        with self.usb_loop() as plc:
            self.put("good")
            self.assertEqual(plc.inspect(600)["verdict"], PASS, self.journal())
            self.put("bad_gloss")
            bad = plc.inspect(601)
            self.assertEqual((bad["verdict"], bad["reasons"] & 1), (REJECT, 1), self.journal())
            with self.subTest("exposures that are taken and not applied"):
                self.put("good", "deaf")
                deaf = plc.inspect(602)
                self.assertEqual((deaf["verdict"], deaf["reasons"], deaf["error"]), (NOT_JUDGED, HARDWARE, IMPLAUSIBLE), self.journal())
                self.assert_dark()
            with self.subTest("unplugged in mid-bracket and back"):
                self.inspect_until_light_2_burns(plc, 603)
                self.put("good", "unplugged")
                gone = plc.result()
                self.assertEqual((gone["verdict"], gone["reasons"], gone["error"]), (NOT_JUDGED, HARDWARE, ABSENT), self.journal())
                self.assert_dark()
                plc.until(lambda: plc.words(3, 1)[0] == ERROR, "in error")
                self.put("good")
                plc.until(lambda: plc.words(3, 1)[0] != ERROR, "taken into use without a restart")
                self.assertEqual(plc.inspect(604)["verdict"], PASS, self.journal())


class Tally(unittest.TextTestResult):
    passed = 0

    def startTest(self, test):
        super().startTest(test)
        self.begun = time.monotonic()

    def stopTest(self, test):
        super().stopTest(test)
        self.stream.writeln(f"  {time.monotonic() - self.begun:.0f} s")

    def addSuccess(self, test):
        super().addSuccess(test)
        self.passed += 1


def tests(names):
    loader = unittest.defaultTestLoader
    return unittest.TestSuite(map(LabTest, names)) if names else loader.loadTestsFromTestCase(LabTest)


if __name__ == "__main__":
    outcome = unittest.TextTestRunner(verbosity=2, resultclass=Tally).run(tests(sys.argv[3:]))
    failed = len({str(test).split(" (")[0] for test, _ in outcome.failures + outcome.errors})
    print(f"kernel lab: {outcome.passed} passed, {failed} failed")
    sys.exit(0 if outcome.wasSuccessful() and outcome.passed > 0 else 1)
