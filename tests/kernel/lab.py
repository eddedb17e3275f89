"""A QEMU guest with a Debian kernel, and the hand that runs scripts in it."""
import atexit
import pathlib
import shutil
import socket
import subprocess
import time


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Guest:
    """Boots the image with a read-only disk of our own under /lab; changes to the image are forgotten.

    No KVM: stock kernels hang under some hosts' nested one. QEMU's TCG is slow, so order and recovery can be
    asserted in it, never latency.
    """

    def __init__(self, folder, payload, log, forwards):
        self.agent = free_port()
        self.log = pathlib.Path(log)
        hostfwd = "".join(f",hostfwd=tcp:127.0.0.1:{host}-:{guest}" for host, guest in [(self.agent, 5000), *forwards])
        self.process = subprocess.Popen(
            ["qemu-system-x86_64", "-machine", "pc", "-accel", "tcg,thread=multi,tb-size=256", "-cpu", "Nehalem", "-smp", "2",
             "-m", "1024", "-nodefaults", "-display", "none", "-no-reboot",
             "-kernel", f"{folder}/vmlinuz", "-initrd", f"{folder}/initrd.gz", "-append",
             "console=ttyS0 no_timer_check nowatchdog panic=1 net.ifnames=0 mitigations=off audit=0 apparmor=0 quiet rw systemd.show_status=0",
             "-drive", f"file={folder}/root.img,format=raw,if=virtio,snapshot=on",
             "-drive", f"file={payload},format=raw,if=virtio,readonly=on",
             "-netdev", f"user,id=n{hostfwd}", "-device", "virtio-net-pci,netdev=n",
             "-serial", f"file:{log}"], stdin=subprocess.DEVNULL)
        atexit.register(self.stop)

    def wait(self, limit=300):
        """Until the agent answers."""
        deadline = time.monotonic() + limit
        while time.monotonic() < deadline:
            if self.process.poll() is not None:
                raise AssertionError(f"the guest died:\n{self.console()}")
            try:
                if self.run("true", limit=60)[0] == 0:
                    return
            except OSError:
                time.sleep(0.5)  # nothing to wait on: the port is forwarded before anybody listens
        raise AssertionError(f"the guest does not answer after {limit} s:\n{self.console()}")

    def run(self, script, limit=300):
        """Exit code and output of a shell script."""
        with socket.create_connection(("127.0.0.1", self.agent), timeout=limit) as s:
            s.sendall(script.encode())
            s.shutdown(socket.SHUT_WR)
            answer = b""
            while chunk := s.recv(65536):
                answer += chunk
        text, found, code = answer.decode(errors="replace").rpartition("\nexit ")
        if not found:
            raise OSError("no answer")
        return int(code), text

    def must(self, script, limit=300):
        code, text = self.run(script, limit)
        if code != 0:
            raise AssertionError(f"exit code {code} of: {script}\n{text}")
        return text

    def console(self):
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-30:]) if self.log.exists() else ""

    def stop(self):
        self.process.kill()
        self.process.wait()


def libraries_for(programs, present):
    """Shared libraries that the programs need and the guest has not: {name: path}."""
    needed = {}
    for program in programs:
        for line in subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout.splitlines():
            words = line.split()
            if "=>" in words and words[0] not in present:
                needed[words[0]] = words[2]
    return needed


def make_payload(image, content):
    """An ext4 image of a folder."""
    image = pathlib.Path(image)
    image.unlink(missing_ok=True)
    size = int(subprocess.run(["du", "-sm", str(content)], capture_output=True, text=True, check=True).stdout.split()[0]) + 64
    subprocess.run([shutil.which("mke2fs") or "/sbin/mke2fs", "-q", "-t", "ext4", "-O", "^has_journal", "-d", str(content), str(image),
                    f"{size}M"], check=True, stdout=subprocess.DEVNULL)
