"""A Slurm of a test's own (tests/cluster/slurm). Without its packages the test is skipped by name."""
import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import time

SLURM = os.path.join(os.path.dirname(os.path.abspath(__file__)), "slurm")


@contextlib.contextmanager
def free_ports(n):
    """The first of n ports in a row, 64 at most, that nobody listens on. Other tests get others meanwhile: the name of a socket, which ends
    with the process, stands for each 64."""
    assert n <= 64
    for _ in range(1000):
        port = random.randrange(20032, 32000, 64)
        with contextlib.ExitStack() as held:
            try:
                held.enter_context(socket.socket(socket.AF_UNIX)).bind("\0acut-test-ports-%d" % port)
                for i in range(n):
                    with socket.socket() as s:
                        s.bind(("127.0.0.1", port + i))
            except OSError:
                continue
            yield port
            return
    sys.exit("no free ports")


class Slurm:
    def __init__(self, folder, nodes):
        self.folder = folder
        self.env = {}
        self.nodes = nodes

    def do(self, verb, *args):
        return subprocess.run([SLURM, verb, self.folder, *map(str, args)], check=True, env={**os.environ, **self.env})

    def lose(self, node):
        """A node, with all that runs on it. The controller learns it at once, unless ACUT_SLURM_NOTICES is set: then it finds out by itself,
        which takes half a minute."""
        self.do("lose", node)
        if "ACUT_SLURM_NOTICES" not in os.environ:
            self.run("scontrol", "update", "nodename=" + node, "state=down", "reason=lost")

    def run(self, *argv):
        return subprocess.run(argv, env={**os.environ, **self.env}, capture_output=True, text=True, check=True).stdout

    def queue(self):
        return [line.split("|") for line in self.run("squeue", "-h", "-r", "-o", "%F|%K|%T|%j|%N").splitlines()]

    def until(self, what, cond, seconds=240):
        end = time.time() + seconds
        while not cond():
            if time.time() > end:
                sys.exit("%s: not after %d s\n%s" % (what, seconds, self.run("squeue", "-t", "all")))
            time.sleep(0.1)


@contextlib.contextmanager
def slurm(folder, nodes, **settings):
    """settings: as SLURM_TEST_ARRAY, without the prefix."""
    s = Slurm(folder, nodes)
    os.makedirs(folder)
    os.chmod(os.path.dirname(folder), 0o755)  # munge wants that all may reach its socket
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # the Slurm ends with the test
    env = {**os.environ, **{"SLURM_TEST_" + k.upper(): str(v) for k, v in settings.items()}}
    with free_ports(nodes + 1) as port:
        p = subprocess.run([SLURM, "up", folder, str(nodes), str(port)], env=env, capture_output=True, text=True)
        try:
            if p.returncode == 77:
                print("skipped: " + p.stderr)
                sys.exit(77)
            if p.returncode:
                sys.exit(p.stderr)
            s.env = {"SLURM_CONF": os.path.join(folder, "etc/slurm.conf")}
            yield s
        finally:
            subprocess.run([SLURM, "down", folder])
