"""Holds system calls of a process until the test releases them: a disk that does not answer."""
import os
import signal
import subprocess

from e2e import expect, until


class Held:
    """Holds the first fsync of each thread of a process, from now on until let_go(). `more` for strace: -P PATH, to hold those of
    one path."""

    def __init__(self, pid, trace, *more, calls="fsync,fdatasync"):
        self.trace = trace
        self.tracer = subprocess.Popen(["strace", "-f", "-qq", "-o", trace, "-p", str(pid), *more, "-e", "trace=" + calls, "-e",
                                        "inject=%s:delay_exit=3600000000:when=1" % calls], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        until(lambda: self.attached(pid), "strace does not attach")

    def attached(self, pid):
        expect(self.tracer.poll() is None, "strace has ended: %s" % self.tracer.returncode)
        tracers = set()
        for task in os.listdir("/proc/%d/task" % pid):
            try:
                with open("/proc/%d/task/%s/status" % (pid, task)) as f:
                    tracers.update(line.split()[1] for line in f if line.startswith("TracerPid"))
            except OSError:
                return False  # a thread has just ended
        return tracers == {str(self.tracer.pid)}

    def one(self):
        """True if a call is being held."""
        with open(self.trace) as f:
            return "(DELAYED)" in f.read()

    def wait(self):
        until(self.one, "no call came to be held")

    def let_go(self):
        self.tracer.send_signal(signal.SIGINT)
        self.tracer.wait()
