#!/usr/bin/env python3
"""The PLC contract, seen by two clients that share no code with it: pymodbus and mbpoll.

    plc_contract.py HOST PORT [--triggers ID ...] [--word-order abcd|cdab]

Wants a running gate that is ready and has a recipe or none. Says what it checked, one line each; exit code 1 with the first
check that fails.
"""
import argparse
import math
import re
import struct
import subprocess
import sys
import time

from pymodbus.client import ModbusTcpClient  # Debian: needs python3-serial-asyncio, which its package only recommends
from pymodbus.mei_message import ReadDeviceInformationRequest
from pymodbus.pdu import ModbusRequest

STEP_S = 60
ENABLE, TRIGGER, ACK, CLEAR, RECIPE = 1, 2, 4, 8, 16
READY, BUSY, TRIGGER_ACK, ACQUISITION_DONE, RESULT_VALID = 1, 2, 4, 8, 16
PASS, REJECT, NOT_JUDGED = 32, 64, 128
VERDICT_BITS = PASS | REJECT | NOT_JUDGED
MISSED = 1 << 10
WARNING = 1 << 9
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, SERVER_BUSY = 1, 2, 3, 6


def check(holds, what):
    if not holds:
        raise AssertionError(what)


class UserFunction(ModbusRequest):
    """A function code that the gate does not serve."""

    function_code = 0x17
    _rtu_frame_size = 8

    def encode(self):
        return struct.pack(">HHHHBH", 0, 1, 1000, 1, 2, 0)

    def get_response_pdu_size(self):
        return 2


class Plc:
    def __init__(self, host, port, order):
        self.client = ModbusTcpClient(host, port=port, timeout=5)
        check(self.client.connect(), f"connect to {host}:{port}")
        self.order = order

    def close(self):
        self.client.close()

    def read(self, address, count):
        answer = self.client.read_input_registers(address, count, slave=1)
        check(not answer.isError(), f"read {count} registers from {address}: {answer}")
        check(len(answer.registers) == count, f"{len(answer.registers)} registers instead of {count}")
        return answer.registers

    def write(self, address, values):
        answer = self.client.write_registers(address, values, slave=1)
        check(not answer.isError(), f"write {values} to {address}: {answer}")

    def command(self, bits):
        self.write(1000, [bits])

    def status(self):
        return self.read(4, 1)[0]

    def u32(self, words):
        return words[0] << 16 | words[1] if self.order == "abcd" else words[1] << 16 | words[0]

    def words(self, value):
        pair = [value >> 16, value & 0xFFFF]
        return pair if self.order == "abcd" else pair[::-1]

    def f32(self, words):
        return struct.unpack(">f", struct.pack(">I", self.u32(words)))[0]

    def wait(self, bits, value, what):
        deadline = time.monotonic() + STEP_S
        while time.monotonic() < deadline:
            status = self.status()
            if status & bits == value:
                return status
            check(exactly_one_verdict(status), f"status {status:#06x} while waiting for {what}")
        raise AssertionError(f"no {what} within {STEP_S} s; status {self.status():#06x}, state {self.read(3, 1)[0]}")


def exactly_one_verdict(status):
    """One verdict bit with result_valid, none without."""
    return bin(status & VERDICT_BITS).count("1") == (1 if status & RESULT_VALID else 0)


def exception_of(answer):
    return answer.exception_code if answer.isError() and hasattr(answer, "exception_code") else None


def the_map_says_who_it_is(plc):
    check(plc.u32(plc.read(0, 2)) == 0x42524446, "magic")
    check(plc.read(2, 1)[0] == 0x0100, "map version")
    check(plc.f32(plc.read(90, 2)) == 1.0, "float_check")
    check(plc.u32(plc.read(92, 2)) == 0x01020304, "word_check")
    check(plc.read(18, 22) == [0] * 22, "unassigned registers read 0")
    check(any(plc.read(9, 4)), "config_hash")
    check(plc.read(15, 1)[0] in (1, 3), "channels")


def the_device_identifies_itself(plc):
    request = ReadDeviceInformationRequest(1, 0)
    request.unit_id = 1
    answer = plc.client.execute(request)
    check(not answer.isError(), f"device identification: {answer}")
    check(all(answer.information.get(i) for i in (0, 1, 2)), f"vendor, product and revision: {answer.information}")


def holding_registers_mirror_input_registers(plc):
    # The heartbeat and uptime move on between two reads.
    moving = {5, 16, 17}
    count = 125
    for address in range(0, 1000, count):
        first = plc.read(address, count)
        answer = plc.client.read_holding_registers(address, count, slave=1)
        check(not answer.isError(), f"FC 03 from {address}: {answer}")
        for i, (a, b) in enumerate(zip(first, answer.registers)):
            check(a == b or address + i in moving, f"register {address + i}: {a} by FC 04, {b} by FC 03")
    bits = plc.client.read_discrete_inputs(0, 16, slave=1).bits[:16]
    check(sum(1 << i for i, bit in enumerate(bits) if bit) == plc.status(), "discrete inputs are the status bits")


def what_does_not_exist_is_refused(plc):
    client = plc.client
    check(exception_of(client.read_input_registers(1000, 1, slave=1)) == ILLEGAL_ADDRESS, "FC 04 from 1000")
    check(exception_of(client.read_input_registers(999, 2, slave=1)) == ILLEGAL_ADDRESS, "FC 04 across 1000")
    check(exception_of(client.read_holding_registers(1005, 1, slave=1)) == ILLEGAL_ADDRESS, "FC 03 at 1005")
    check(exception_of(client.read_holding_registers(1000, 6, slave=1)) == ILLEGAL_ADDRESS, "FC 03 past 1004")
    for address in (0, 100, 107, 999, 1005):
        check(exception_of(client.write_register(address, 1, slave=1)) == ILLEGAL_ADDRESS, f"write to {address}")
    check(exception_of(client.write_registers(1004, [0, 0], slave=1)) == ILLEGAL_ADDRESS, "write across the end")
    check(exception_of(client.write_register(1000, 0x20, slave=1)) == ILLEGAL_VALUE, "a command bit that is none")
    request = UserFunction()
    request.unit_id = 1
    check(exception_of(client.execute(request)) == ILLEGAL_FUNCTION, "function code 23")
    before = client.read_holding_registers(1000, 5, slave=1).registers
    unknown = client.write_registers(1000, [RECIPE, 0, 77, 64999, 0], slave=1)
    check(exception_of(unknown) == ILLEGAL_VALUE, f"an unknown recipe: {unknown}")
    check(client.read_holding_registers(1000, 5, slave=1).registers == before, "nothing of a refused request is applied")


def a_trigger_while_not_enabled_is_missed(plc):
    plc.command(0)
    missed = plc.u32(plc.read(48, 2))
    plc.command(TRIGGER)
    check(plc.status() & MISSED, "missed_trigger")
    check(not plc.status() & (BUSY | TRIGGER_ACK), "nothing begins")
    check(plc.u32(plc.read(48, 2)) == missed + 1, "missed_triggers counts")
    plc.command(CLEAR)
    check(not plc.status() & MISSED, "clear_error clears missed_trigger")
    plc.command(0)


def read_result(plc):
    block = plc.read(100, 26)
    sequence = plc.u32(block[0:2])
    check(plc.u32(block[24:26]) == sequence, "sequence first and last")
    reals = [plc.f32(block[i:i + 2]) for i in (10, 12, 14, 16, 18)]
    check(all(math.isfinite(x) for x in reals), f"finite values: {reals}")
    return {"sequence": sequence, "trigger_id": plc.u32(block[2:4]), "result_id": plc.u32(block[4:6]), "state": block[6],
            "verdict": block[7], "reasons": block[8], "block": block}


def check_clusters(plc, result):
    weights_seen = 0
    for c in range(8):
        block = plc.read(200 + 100 * c, 76)
        check(plc.u32(block[0:2]) == plc.u32(block[74:76]) == result["sequence"], f"sequence of cluster {c}")
        reals = [plc.f32(block[i:i + 2]) for i in range(4, 74, 2)]
        check(all(math.isfinite(x) for x in reals), f"finite values of cluster {c}")
        weights = reals[11:]
        present, valid = block[2] & 1, block[2] & 2
        check(any(weights) == bool(valid), f"weights of cluster {c}: valid bits {block[2]}, {weights}")
        check(present or not any(block[3:74]), f"an absent cluster {c} is empty")
        weights_seen += bool(valid)
    return weights_seen


def one_part(plc, trigger_id, last_result, stale_ack=False):
    plc.wait(READY, READY, "ready")
    before = read_result(plc)
    plc.write(1001, plc.words(trigger_id))
    plc.command(ENABLE | TRIGGER)
    status = plc.wait(TRIGGER_ACK, TRIGGER_ACK, "trigger_ack")
    if not status & RESULT_VALID:
        fresh = read_result(plc)
        check(fresh["trigger_id"] == trigger_id and fresh["sequence"] != before["sequence"], "a fresh block with trigger_ack")
        check(fresh["state"] != 2 or fresh["block"][7:24] == [0] * 17, f"nothing in it while processing: {fresh}")
    if stale_ack:
        plc.command(ENABLE | TRIGGER | ACK)
    plc.wait(ACQUISITION_DONE, ACQUISITION_DONE, "acquisition_done")
    status = plc.wait(RESULT_VALID, RESULT_VALID, "result_valid")
    result = read_result(plc)
    check(exactly_one_verdict(status) and not status & BUSY, f"status {status:#06x}")
    check(status & VERDICT_BITS == 1 << (4 + result["verdict"]), f"verdict {result['verdict']} beside status {status:#06x}")
    check(result["trigger_id"] == trigger_id, f"trigger_id {result['trigger_id']} for {trigger_id}")
    check(result["result_id"] > last_result, f"result_id {result['result_id']} after {last_result}")
    check(result["state"] in (1, 3, 4), f"result_state {result['state']}")
    check(not (result["verdict"] == 1 and result["reasons"]), f"a pass with reasons {result['reasons']:#06x}")
    check(result["verdict"] == 1 or result["reasons"], "a reason for what is not a pass")
    weights = check_clusters(plc, result)
    check(weights or result["verdict"] == 3, "weights of a judged part")
    acquisition, processing, cycle = result["block"][20:23]
    check(cycle == 65535 or abs(cycle - acquisition - processing) <= 2, f"{acquisition} + {processing} ms against {cycle}")
    return result, weights


def finish(plc):
    plc.command(ENABLE | TRIGGER | ACK)
    check(not plc.status() & (RESULT_VALID | VERDICT_BITS), "result_valid drops on the acknowledgement")
    plc.command(ENABLE | ACK)
    check(not plc.status() & (TRIGGER_ACK | READY), "trigger_ack drops with trigger; no ready beside result_ack")
    plc.command(ENABLE)
    plc.wait(READY, READY, "ready")


def whole_handshakes(plc, triggers):
    plc.command(0)
    plc.command(ENABLE)
    inspected = plc.u32(plc.read(40, 2))
    last, with_weights = plc.u32(plc.read(104, 2)), 0
    for trigger_id in [*triggers, 0xFEDC0001]:
        result, weights = one_part(plc, trigger_id, last)
        last, with_weights = result["result_id"], with_weights + bool(weights)
        finish(plc)
    counters = [plc.u32(pair) for pair in zip(*[iter(plc.read(40, 8))] * 2)]
    check(counters[0] == inspected + len(triggers) + 1, f"inspected: {counters[0]} after {inspected}")
    check(counters[0] == sum(counters[1:]), f"inspected = passed + rejected + not judged: {counters}")
    check(with_weights, "weights of at least one part")


def a_stale_acknowledgement_does_nothing(plc):
    one_part(plc, 1, 0, stale_ack=True)
    plc.command(ENABLE | ACK)
    check(plc.status() & RESULT_VALID, "a stale high result_ack does not acknowledge")
    check(not plc.status() & READY, "and keeps ready low")
    plc.command(ENABLE)
    plc.command(ENABLE | ACK)
    check(not plc.status() & RESULT_VALID, "its next rising edge does")
    plc.command(ENABLE)
    plc.wait(READY, READY, "ready")


def a_trigger_while_busy_is_missed(plc):
    missed = plc.u32(plc.read(48, 2))
    plc.command(ENABLE | TRIGGER)
    check(not plc.status() & READY, "no ready beside trigger")
    # Whether still busy or already done, result_ack high keeps the gate from being ready.
    plc.command(ENABLE | ACK)
    plc.command(ENABLE | ACK | TRIGGER)
    check(plc.status() & MISSED, "missed_trigger")
    check(plc.u32(plc.read(48, 2)) == missed + 1, "missed_triggers counts")
    plc.command(ENABLE)
    plc.wait(RESULT_VALID | BUSY, RESULT_VALID, "the first trigger's result, and no other")
    plc.command(ENABLE | ACK)
    plc.command(ENABLE)
    plc.wait(READY, READY, "ready")


def a_second_writer_is_refused(plc, other):
    answer = other.client.write_register(1000, 0, slave=1)
    check(exception_of(answer) == SERVER_BUSY, f"a second writer: {answer}")
    check(plc.read(7, 1)[0] & 1 << 8 and plc.status() & WARNING, "warning bit 8")
    check(other.u32(other.read(0, 2)) == 0x42524446, "a second reader reads")
    plc.command(ENABLE | CLEAR)
    check(not plc.read(7, 1)[0] & 1 << 8, "clear_error clears it")
    plc.command(ENABLE)


def coils_are_command_bits(plc):
    bits = plc.client.read_coils(0, 5, slave=1).bits[:5]
    check(bits == [True, False, False, False, False], f"coils {bits}")
    check(not plc.client.write_coil(0, False, slave=1).isError(), "write a coil")
    check(plc.client.read_holding_registers(1000, 1, slave=1).registers == [0], "trigger_enable by coil")
    check(not plc.client.write_coils(0, [True, False, False, False, False], slave=1).isError(), "write coils")
    plc.wait(READY, READY, "ready by coil")
    check(exception_of(plc.client.write_coil(5, True, slave=1)) == ILLEGAL_ADDRESS, "coil 5")


def mbpoll(host, port, address, *options):
    # -0: addresses as they stand in the request; -1: once.
    done = subprocess.run(["mbpoll", "-m", "tcp", "-a", "1", "-0", "-1", "-p", str(port), "-r", str(address), *options, host],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=30, check=False)
    values = re.findall(r"^\[(\d+)\]:\s+(\S+)", done.stdout, re.MULTILINE)
    check(done.returncode == 0 and values, f"mbpoll at {address}: {done.stdout}")
    return [value for _, value in values]


def mbpoll_reads_the_same(plc, host, port):
    swap = ["-B"] if plc.order == "abcd" else []
    check(float(mbpoll(host, port, 90, "-t", "3:float", *swap)[0]) == 1.0, "float_check by mbpoll")
    block = plc.read(100, 26)
    seen = [int(v, 16) for v in mbpoll(host, port, 100, "-t", "3:hex", "-c", "26")]
    check(seen == block, f"result block by mbpoll: {seen} instead of {block}")
    check([int(v, 16) for v in mbpoll(host, port, 100, "-t", "4:hex", "-c", "26")] == block, "the same as holding registers")
    weight = float(mbpoll(host, port, 226, "-t", "3:float", *swap)[0])
    check(math.isclose(weight, plc.f32(plc.read(226, 2)), rel_tol=1e-4, abs_tol=1e-4), f"first weight {weight} by mbpoll")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("host")
    parser.add_argument("port", type=int)
    parser.add_argument("--triggers", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--word-order", choices=["abcd", "cdab"], default="abcd")
    options = parser.parse_args()
    plc = Plc(options.host, options.port, options.word_order)
    other = Plc(options.host, options.port, options.word_order)
    steps = [(the_map_says_who_it_is, plc), (the_device_identifies_itself, plc), (holding_registers_mirror_input_registers, plc),
             (what_does_not_exist_is_refused, plc), (a_trigger_while_not_enabled_is_missed, plc),
             (whole_handshakes, plc, options.triggers), (a_stale_acknowledgement_does_nothing, plc),
             (a_trigger_while_busy_is_missed, plc), (a_second_writer_is_refused, plc, other), (coils_are_command_bits, plc),
             (holding_registers_mirror_input_registers, plc), (mbpoll_reads_the_same, plc, options.host, options.port)]
    failed = 0
    for step, *arguments in steps:
        try:
            step(*arguments)
        except AssertionError as error:
            failed += 1
            print(f"FAILED {step.__name__.replace('_', ' ')}: {error}", flush=True)
            break
        print(f"ok {step.__name__.replace('_', ' ')}", flush=True)
    plc.command(0)
    plc.close()
    other.close()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
