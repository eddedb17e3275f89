#!/usr/bin/env python3
"""Cameras that fail under the shipped daemon: what the PLC is told, and that it works again.    test_camera_faults.py PROGRAMS FOLDER"""
import re
import sys
import time
import unittest

import test_daemon
from plc_contract import ACK, CLEAR, ENABLE, NOT_JUDGED, PASS, READY, RESULT_VALID, TRIGGER, TRIGGER_ACK, Plc
from test_daemon import daemon

BENCH = test_daemon.BENCH
FAULT = BENCH.folder / "camera_fault"
STATE_ERROR, STATE_READY = 2, 4
CAMERA, LIGHTS, ABSENT, MEMORY, FRAMES = 10, 11, 13, 15, 16
HARDWARE = 1 << 12
COMPLETED, FAILED = 1, 4
PATIENCE_S = 60


def station_with_fault_file():
    station = BENCH.folder / "faulty.station.yaml"
    station.write_text(re.sub(r"^simulator:.*\n", "simulator:\n  camera_fault_file: camera_fault\n", BENCH.station.read_text(),
                              flags=re.MULTILINE))
    return station


def station_with_hardware():
    """A station file for a board, on a machine that has neither its camera nor its lights."""
    text = BENCH.station.read_text()
    text = re.sub(r"^simulator:.*\n(  .*\n)+", "lights: {chip: gpiochip-none, lines: ['17', '27']}\n", text, flags=re.MULTILINE)
    text = re.sub(r"  scenes:.*\n(    - .*\n|\s+#.*\n)+", "", text)
    text = re.sub(r"  seed: .*\n", "", text)
    text = text.replace("backend: simulated\n", "backend: v4l2\n  device: {path: /dev/video-none, pixel_format: SRGGB10P, "
                        "control_delay_frames: 3, line_time_us: 14.8}\n")
    station = BENCH.folder / "hardware.station.yaml"
    station.write_text(text)
    return station


class Station:
    def __init__(self, port):
        self.plc = Plc("127.0.0.1", port, "abcd")

    def until(self, holds, what):
        deadline = time.monotonic() + PATIENCE_S
        while not holds():
            if time.monotonic() > deadline:
                raise AssertionError(f"{what}: state {self.state()}, status {self.plc.status():#x}, error {self.error()}")

    def state(self):
        return self.plc.read(3, 1)[0]

    def error(self):
        return self.plc.read(6, 1)[0]

    def status_has(self, bits):
        return self.plc.status() & bits == bits

    def inspect(self):
        """One handshake: (verdict bits, result_state, reason_bits)."""
        self.plc.command(ENABLE)
        self.until(lambda: self.status_has(READY), "ready")
        self.plc.write(1000, [ENABLE | TRIGGER, 0, 1])
        self.until(lambda: self.status_has(RESULT_VALID), "a result")
        status = self.plc.status()
        block = self.plc.read(100, 26)
        self.plc.command(ENABLE | ACK)
        self.until(lambda: not self.plc.status() & TRIGGER_ACK, "the end of the handshake")
        self.plc.command(ENABLE)
        return status & (PASS | NOT_JUDGED), block[6], block[8]

    def clear(self):
        self.plc.command(ENABLE | CLEAR)
        self.plc.command(ENABLE)


class CameraFaultsTest(unittest.TestCase):
    def setUp(self):
        self.station, BENCH.station = BENCH.station, station_with_fault_file()
        FAULT.unlink(missing_ok=True)

    def tearDown(self):
        BENCH.station = self.station

    def test_a_part_with_a_failing_camera_is_not_judged_and_the_next_one_is(self):
        # Of a part's ten frames two are without light, four under light 2 and four under light 1.
        cases = [("unplugged 5", ABSENT), ("lost 4", CAMERA), ("black 4", FRAMES), ("frozen 3", FRAMES), ("not_applied 4", FRAMES)]
        with daemon("camera_faults", "--recipe", BENCH.recipe) as (_, port):
            station = Station(port)
            for fault, code in cases:
                with self.subTest(fault=fault):
                    FAULT.write_text(fault + "\n")
                    self.assertEqual(station.inspect(), (NOT_JUDGED, FAILED, HARDWARE))
                    self.assertEqual(station.error(), code)
                    FAULT.unlink()
                    station.until(lambda: station.state() == STATE_READY, "back to work")
                    self.assertEqual(station.error(), code, "kept until cleared")
                    station.clear()
                    # Measured and judged; one good part in a few hundred is rejected by chance.
                    verdict, state, reasons = station.inspect()
                    self.assertEqual((verdict & NOT_JUDGED, state, reasons & HARDWARE), (0, COMPLETED, 0))
                    self.assertEqual(station.error(), 0)

    def test_a_camera_that_is_away_is_an_error_of_the_station_until_it_comes(self):
        for fault, code in (("absent", ABSENT), ("out_of_memory", MEMORY)):
            with self.subTest(fault=fault):
                FAULT.write_text(fault + "\n")
                with daemon("camera_" + fault, "--recipe", BENCH.recipe) as (_, port):
                    station = Station(port)
                    station.plc.command(ENABLE)
                    station.until(lambda: station.state() == STATE_ERROR, "an error at the start")
                    self.assertEqual(station.error(), code)
                    station.plc.write(1000, [ENABLE | TRIGGER, 0, 1])
                    self.assertFalse(station.status_has(READY) or station.status_has(PASS))
                    FAULT.unlink()
                    station.plc.command(ENABLE)
                    station.until(lambda: station.state() == STATE_READY, "taken into use without a restart")
                    station.clear()
                    self.assertEqual(station.inspect()[1], COMPLETED)
                    # And while it is in use.
                    FAULT.write_text(fault + "\n")
                    station.until(lambda: station.state() == STATE_ERROR, "an error in use")
                    self.assertFalse(station.status_has(PASS))
                    FAULT.unlink()
                    station.until(lambda: station.state() == STATE_READY, "back again")

    def test_a_board_without_its_camera_and_lights_starts_and_says_so(self):
        BENCH.station = station_with_hardware()
        done = BENCH.run("capture", "--config", BENCH.station, "--out", BENCH.folder / "nothing")
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)
        with daemon("hardware", "--recipe", BENCH.recipe) as (_, port):
            station = Station(port)
            station.until(lambda: station.state() == STATE_ERROR, "an error")
            self.assertIn(station.error(), (LIGHTS, ABSENT))
            self.assertEqual(station.plc.status() & (1 << 12), 0, "not simulated")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
