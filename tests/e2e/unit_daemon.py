"""A daemon of a test as a unit of the system's manager, with the sandbox of the shipped acutd.service: with its own folders,
socket and options; otherwise as shipped, except that a forbidden system call kills it. For containers (tests/systemd). Used if
ACUT_UNIT_DAEMON names the shipped unit's file."""
import os
import pwd
import re
import shutil
import signal
import subprocess
import time

SHIPPED = os.environ.get("ACUT_UNIT_DAEMON")
UNITS = "/run/systemd/system"
# Of the shipped unit: what is about its own folders and restarts, what makes an error of a call that is not allowed.
OWN = re.compile(r"^(ExecStart|ExecReload|(State|Cache|Runtime)Directory\w*|Restart\w*|SystemCallErrorNumber|MemoryMax|Requires|After|"
                 r"StartLimit\w*)=")
sandboxed = 0  # daemons that were seen in it


def systemctl(*args):
    return subprocess.run(["systemctl"] + list(args), stdout=subprocess.PIPE, stderr=subprocess.STDOUT).stdout.decode()


def quoted(words):
    return " ".join('"%s"' % w.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$") for w in words)


class Process:
    """The unit's main process, with the methods of subprocess.Popen."""

    def __init__(self, daemon):
        command = list(daemon.command)
        at = command.index("--socket")
        del command[at:at + 2]
        self.name = "acutd-test-%d-%s" % (os.getpid(), re.sub(r"\W", "-", daemon.socket))
        self.returncode = None
        self.pid = 0
        with open(SHIPPED) as f:
            lines = [line for line in f.read().split("\n") if not OWN.match(line)]
        service = lines.index("[Service]")
        lines[service + 1:service + 1] = [
            "ExecStart=" + quoted(command), "ReadWritePaths=" + daemon.base, "StandardOutput=append:" + daemon.log,
            "StandardError=append:" + daemon.log, "Restart=no"]
        lines[service + 1:service + 1] = ["Environment=" + quoted(["%s=%s" % (k, v)]) for k, v in daemon.env.items()
                                          if os.environ.get(k) != v]
        lines[service:service] = ["StartLimitIntervalSec=0"]
        with open("%s/%s.service" % (UNITS, self.name), "w") as f:
            f.write("\n".join(lines))
        with open("%s/%s.socket" % (UNITS, self.name), "w") as f:
            f.write("[Socket]\nListenStream=%s\nSocketMode=0666\n" % daemon.socket)
        user = pwd.getpwnam("acut")
        for path in [daemon.base, daemon.log] + [os.path.join(top, n) for t in (daemon.state, daemon.cache) if os.path.exists(t)
                                                 for top, dirs, files in [(t, [], [""])] + list(os.walk(t)) for n in dirs + files]:
            shutil.chown(path, user.pw_uid, user.pw_gid)
        systemctl("daemon-reload")
        systemctl("start", self.name + ".socket", self.name + ".service")
        # acutd has it. Whoever comes when acutd has ended must not start it again.
        systemctl("stop", self.name + ".socket")
        self.look()
        if self.returncode is None:
            self.judge()

    def judge(self):
        global sandboxed
        with open("/proc/%d/status" % self.pid) as f:
            status = dict(line.rstrip("\n").split(":\t", 1) for line in f if ":\t" in line)
        if status["Seccomp"] != "2" or status["NoNewPrivs"] != "1" or int(status["CapBnd"], 16) or status["Uid"].split()[0] == "0":
            raise AssertionError("not in its sandbox: %s" % status)
        sandboxed += 1

    def look(self):
        show = dict(line.split("=", 1) for line in systemctl(
            "show", self.name + ".service", "-p", "ActiveState,MainPID,ExecMainCode,ExecMainStatus").split("\n") if "=" in line)
        if show["ActiveState"] in ("inactive", "failed"):
            status = int(show["ExecMainStatus"])
            self.returncode = status if show["ExecMainCode"] == "1" else -status
            systemctl("reset-failed", self.name + ".service", self.name + ".socket")
            if self.returncode == -signal.SIGSYS:
                raise AssertionError("acutd was killed for a call that its unit does not allow")
        elif int(show["MainPID"]):
            self.pid = int(show["MainPID"])
        return self.returncode

    def poll(self):
        return self.returncode if self.returncode is not None else self.look()

    def wait(self, timeout=None):
        deadline = time.monotonic() + (timeout or 1e9)
        while self.poll() is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(self.name, timeout)
            time.sleep(0.02)
        return self.returncode

    def send_signal(self, sig):
        if self.poll() is None:
            os.kill(self.pid, sig)

    def kill(self):
        self.send_signal(signal.SIGKILL)
