"""SOEM (pysoem) as the master of simulated gateways: one case per run.

A line on standard output asks the test for something; the test answers with a line on standard
input. A failure is an exception.
"""

import argparse
import struct
import sys
import time

import pysoem

import gateway
import image

INTERFACE = "veth0"
CYCLE = 0.001
FRAMES = 50
# A test machine may stall: limits that only a failure reaches.
PATIENCE = 60
STATE_TIMEOUT_US = 30_000_000
REPLY_TIMEOUT_US = 1_000_000
WATCHDOG_MS = 5_000
FRAME_TIMEOUT_US = 20_000
NEW_VERSION = 0x0300


def ask(text):
    """Asks the test for something and waits until it is done."""
    print(text, flush=True)
    assert sys.stdin.readline(), "the test has ended"


def patiently(what):
    """Repeats until the caller leaves the loop; fails after a time."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        yield
    raise AssertionError(f"not in time: {what}")


class Bus:
    """A master with gateways in PREOP, later in OP."""

    def __init__(self, options):
        self.options = options
        self.size = 128 * options.chunks
        self.sequence = 0
        self.master = pysoem.Master()
        self.master.open(INTERFACE)
        self.master.sdo_read_timeout = self.master.sdo_write_timeout = REPLY_TIMEOUT_US
        self.scan()

    def scan(self):
        """Finds the gateways and brings them to PREOP."""
        for _ in patiently("all gateways are found"):
            if self.master.config_init() == self.options.gateways:
                break
        for slave in self.slaves:
            assert slave.name == "ECAN-Lite", slave.name

    @property
    def slaves(self):
        return self.master.slaves

    def to_op(self):
        """From PREOP to OP."""
        for slave in self.slaves:
            gateway.configure(slave, self.options.chunks, self.options.fd)
            self.set_watchdog(slave)
        self.master.config_map()
        if self.options.sync0:
            assert self.master.config_dc()
            for slave in self.slaves:
                slave.dc_sync(True, int(CYCLE * 1e9), int(CYCLE * 1e9 / 2))
        self.reach(pysoem.SAFEOP_STATE)
        for slave in self.slaves:
            assert (len(slave.input), len(slave.output)) == (self.size, self.size)
        self.send(lambda nth: [])
        self.reach(pysoem.OP_STATE)

    def set_watchdog(self, slave):
        """On a busy machine SOEM loses replies, and repeats no access to registers."""
        for _ in patiently("the watchdog is set"):
            try:
                return slave.set_watchdog("processdata", WATCHDOG_MS)
            except pysoem.WkcError:
                pass

    def reach(self, state):
        """Requests a state of all gateways and exchanges process data until they are in it."""
        self.master.state = state
        self.master.write_state()
        for _ in patiently(f"state {state}"):
            self.exchange()
            if self.master.read_state() == state:
                return

    def exchange(self):
        """One cycle; true if every gateway took part.

        On a busy machine the gateways may serve two cycles at once; the second one has no new input.
        """
        time.sleep(CYCLE)
        self.master.send_processdata()
        return self.master.receive_processdata(REPLY_TIMEOUT_US) == self.master.expected_wkc

    def send(self, frames_of):
        """Writes a new image for each gateway."""
        self.sequence = self.sequence % 0xFFFE + 1
        for nth, slave in enumerate(self.slaves):
            slave.output = image.write(self.size, self.sequence, frames_of(nth))

    def echo(self, frames=FRAMES):
        """Sends frames through each gateway, each after the echo of the one before."""
        lengths = (0, 8, 12, 24, 64) if self.options.fd else range(9)
        seen = [None] * len(self.slaves)
        for turn in range(frames):
            data = bytes([turn]) * lengths[turn % len(lengths)]
            self.send(lambda nth: [(0x100 + nth, data)])
            received = [[] for _ in self.slaves]
            for _ in patiently(f"the echoes of turn {turn}"):
                # The same image again until the echo arrives: gateways recognise it as a repeat.
                self.exchange()
                for nth, slave in enumerate(self.slaves):
                    new = image.read(slave.input)
                    if new and new[0] != seen[nth]:
                        seen[nth] = new[0]
                        received[nth] += new[1]
                if all(received):
                    break
            assert received == [[(0x100 + nth, data)] for nth in range(len(self.slaves))], received

    def close(self):
        self.master.state = pysoem.INIT_STATE
        self.master.write_state()
        self.master.close()


def case_echo(bus):
    bus.to_op()
    bus.echo()


def case_sdo(bus):
    for slave in bus.slaves:
        assert slave.sdo_read(0x1008, 0).rstrip(b"\0") == b"ECAN-Lite"
        gateway.expect(slave, 0x1018, 1, "<I", slave.man)
        gateway.expect(slave, 0x1018, 2, "<I", slave.id)
        gateway.write(slave, 0x8010, 3, "<B", 5)
        gateway.expect(slave, 0x8010, 3, "<B", 5)
        aborted(0x06090011, lambda: slave.sdo_read(0x8010, 200))
        aborted(0x06020000, lambda: slave.sdo_read(0x2000, 0))
        aborted(0x06010002, lambda: slave.sdo_write(0xF000, 18, struct.pack("<H", 1)))
        indices = {entry.index for entry in slave.od}
        assert {0x1018, 0x1C12, 0x8010, 0x8011, 0xF000} <= indices, indices


def aborted(code, transfer):
    """Expects an abort with this code."""
    try:
        value = transfer()
    except pysoem.SdoError as error:
        assert error.abort_code == code, hex(error.abort_code)
    else:
        raise AssertionError(f"no abort {code:#010x}: {value!r}")


def case_complete_access_rejected(bus):
    for slave in bus.slaves:
        aborted(0x06010000, lambda: slave.sdo_read(0x8010, 0, 512, True))


def case_complete_access(bus):
    for slave in bus.slaves:
        whole = slave.sdo_read(0x1018, 0, 512, True)
        entries = b"".join(slave.sdo_read(0x1018, subindex) for subindex in range(1, 5))
        # Subindex 0 takes a word.
        assert whole == b"\x04\x00" + entries, whole.hex()
        assert slave.sdo_read(0x1018, 1, 512, True) == entries


def case_firmware(bus):
    ask("package")
    with open(bus.options.file, "rb") as file:
        package = file.read()
    before = gateway.read(bus.slaves[0], 0xF000, 5, "<H")
    assert before != NEW_VERSION
    assert bus.slaves[0].foe_write("ecan_lite_app", 0, package, REPLY_TIMEOUT_US * 10) > 0
    # SOEM's scan takes minutes if a slave leaves during it: first wait until the gateway has left.
    for _ in patiently("the gateway restarts"):
        time.sleep(CYCLE)
        if bus.slaves[0].state_check(pysoem.PREOP_STATE, FRAME_TIMEOUT_US) == pysoem.NONE_STATE:
            break
    bus.scan()
    gateway.expect(bus.slaves[0], 0xF000, 5, "<H", NEW_VERSION)


def case_sii(bus):
    for slave in bus.slaves:
        # ETG.1000.6: vendor ID and product code at words 8 and 10.
        words = struct.unpack("<II", slave.eeprom_read(8) + slave.eeprom_read(10))
        assert words == (slave.man, slave.id), words
        # An unused word is written and restored: the last one.
        last = 1023
        value = slave.eeprom_read(last)[:2]
        slave.eeprom_write(last, b"\x5A\xA5")
        assert slave.eeprom_read(last)[:2] == b"\x5A\xA5"
        slave.eeprom_write(last, value)
        assert slave.eeprom_read(last)[:2] == value


def outage(bus, what):
    """Exchanges frames in OP, then lets the test cause an outage."""
    bus.to_op()
    bus.echo()
    ask(what)


def case_power_cycle(bus):
    outage(bus, "power cycle")
    bus.scan()
    bus.to_op()
    bus.echo()


def case_link_loss(bus):
    outage(bus, "link down")
    assert not any(bus.exchange() for _ in range(3))
    ask("link up")
    for _ in patiently("frames return"):
        if bus.exchange():
            break
    bus.echo()


def case_watchdog(bus):
    """Without process data a gateway leaves OP; it returns when the error is acknowledged."""
    bus.to_op()
    for slave in bus.slaves:
        slave.set_watchdog("processdata", 100)
    bus.echo()
    for _ in patiently("the watchdog expires"):
        bus.master.read_state()
        if all(slave.state == pysoem.SAFEOP_STATE + pysoem.STATE_ERROR for slave in bus.slaves):
            break
    assert all(slave.al_status == 0x001B for slave in bus.slaves)
    for slave in bus.slaves:
        slave.state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
        slave.write_state()
        slave.set_watchdog("processdata", WATCHDOG_MS)
    for _ in patiently("the error is acknowledged"):
        bus.exchange()
        if bus.master.read_state() == pysoem.SAFEOP_STATE:
            break
    bus.reach(pysoem.OP_STATE)
    bus.echo()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("case")
    parser.add_argument("--gateways", type=int, default=1)
    parser.add_argument("--chunks", type=int, default=3)
    parser.add_argument("--fd", action="store_true")
    parser.add_argument("--sync0", action="store_true")
    parser.add_argument("--file")
    # SOEM expects each frame to return within 2 ms, also on a busy machine.
    pysoem.settings.timeouts.ret = FRAME_TIMEOUT_US
    pysoem.settings.timeouts.eeprom = REPLY_TIMEOUT_US
    pysoem.settings.timeouts.tx_mailbox = REPLY_TIMEOUT_US
    pysoem.settings.timeouts.rx_mailbox = REPLY_TIMEOUT_US
    bus = Bus(parser.parse_args())
    try:
        globals()[f"case_{bus.options.case}"](bus)
    finally:
        bus.close()
    print("passed", flush=True)


main()
