"""The configuration of the service: the shipped file, a reload with errors, and a separate disk as described in acutd.conf(5).
(The limit of the unit: service.py.)"""
import json
import os
import re
import subprocess
import sys

sys.path.insert(0, "/opt/acut/tree/tests/e2e")
import e2e
from e2e import expect, main, run, until

ETC = next(d for d in ("/etc/acut", "/usr/local/etc/acut") if os.path.exists(d + "/acutd.conf"))
UNIT = "/run/systemd/system/acutd.service.d"


def systemctl(*args):
    return run(["systemctl", *args], timeout=e2e.PATIENCE)


def show(key):
    return systemctl("show", "-P", key, "acutd.service").out.strip()


def settings():
    lines = run([e2e.ACUTCTL, "config", "show", "--json"], timeout=e2e.PATIENCE).ok().out.splitlines()
    return {s["name"]: s for s in map(json.loads, lines)}


def journal():
    """Entries of all daemons: journald finds the unit by the process, which may be gone by then."""
    run(["journalctl", "--sync"])
    return run(["journalctl", "--no-pager", "-o", "cat", "-b", "_SYSTEMD_UNIT=acutd.service", "+", "UNIT=acutd.service", "+", "SYSLOG_IDENTIFIER=acutd"]).out


def told(text, before=0):
    """Waits until the journal has a text, behind what it had before."""
    until(lambda: text in journal()[before:], lambda: "the journal does not say \"%s\":\n%s" % (text, journal()[-2000:]))


def not_started(why):
    """A start that fails is not repeated for ever, and the journal has the reason."""
    before = len(journal())
    got = systemctl("start", "acutd.service")
    expect(got.status != 0 and show("ActiveState") != "active", "it started: %s %s" % (got.out, got.err))
    if why:
        told(why, before)


class With:
    """Settings in a file of acutd.conf.d, and a drop-in of the unit, within a block."""

    def __init__(self, conf="", unit=""):
        self.conf, self.unit = conf, unit

    def __enter__(self):
        systemctl("stop", "acutd.service")
        os.makedirs(ETC + "/acutd.conf.d", exist_ok=True)
        os.makedirs(UNIT, exist_ok=True)
        self.write(self.conf)
        with open(UNIT + "/config.conf", "w") as f:
            f.write(self.unit)
        systemctl("daemon-reload").ok()
        return self

    def write(self, conf):
        with open(ETC + "/acutd.conf.d/50-test.conf", "w") as f:
            f.write(conf)

    def __exit__(self, *exc):
        systemctl("stop", "acutd.service")
        os.unlink(ETC + "/acutd.conf.d/50-test.conf")
        os.unlink(UNIT + "/config.conf")
        systemctl("daemon-reload").ok()
        systemctl("reset-failed")
        systemctl("start", "acutd.socket").ok()


def shipped():
    """The shipped file names the two groups, and nothing else."""
    s = settings()
    for name, group in (("group", "acut"), ("admin-group", "acut-admin")):
        expect(s[name]["value"] == group and s[name]["file"] == ETC + "/acutd.conf", "%s" % s[name])
    for name, row in s.items():
        expect(name in ("group", "admin-group") or row["origin"] != "file", "%s" % row)
    expect(s["state"]["origin"] == "environment" and s["init-first"]["value"] == "yes", "%s" % s["state"])
    # A user in no group gets an error, a member of the group is served.
    run(["useradd", "--system", "stranger"]).ok()
    run(["useradd", "--system", "-G", "acut", "surveyor"]).ok()
    got = run(["runuser", "-u", "stranger", "--", e2e.ACUTCTL, "config", "show"], timeout=e2e.PATIENCE)
    expect(got.status == 77 and "acut" in got.err, "%d %s" % (got.status, got.err))
    run(["runuser", "-u", "surveyor", "--", e2e.ACUTCTL, "config", "show"], timeout=e2e.PATIENCE).ok()


def reload():
    with With("user-jobs = 3\n") as w:
        expect(settings()["user-jobs"]["value"] == "3", "user-jobs")
        before = show("MainPID")
        w.write("user-jobs = 4\n")
        systemctl("reload", "acutd.service").ok()
        until(lambda: settings()["user-jobs"]["value"] == "4", "the reload had no effect")
        w.write("user-jobs = 5\nmemroy = 1G\n")
        got = systemctl("reload", "acutd.service")
        expect(got.status != 0, "a reload of errors is told to be one")
        told('50-test.conf:2: there is no setting "memroy"')
        until(lambda: show("ActiveState") == "active", lambda: "after a reload of errors it is %s" % show("ActiveState"))
        expect(settings()["user-jobs"]["value"] == "4", "the reload of errors had an effect")
        expect(show("MainPID") == before, "the reload of errors began another daemon")


def disk_for_the_data():
    """The manual's instructions for a separate disk, literally, with another folder."""
    with open("/opt/acut/tree/man/acutd.conf.5.scd") as f:
        page = f.read().split("# A DISK FOR THE DATA")[1].split("\n# ")[0]
    conf, unit, moved, empty = [b.replace("/data", "/srv/data") for b in re.findall(r"^```\n(.*?)^```$", page, re.M | re.S)]
    with With():
        survey = "/srv/config.las"
        run([e2e.SYNTH, "--points", "20000", survey]).ok()
        run([e2e.ACUTCTL, "push", "kept", survey], timeout=e2e.PATIENCE).ok()
    # Without the mount the folder is not a store, and no file is made there.
    os.makedirs("/srv/data")
    with With(conf, unit):
        not_started("")
        expect(not os.listdir("/srv/data"), "it made something where no disk is mounted")
    # The same if somebody has made the folders below the mount point.
    run(["install", "-d", "-o", "acut", "-g", "acut", "-m", "0700", "/srv/data/acut", "/srv/data/acut/state", "/srv/data/acut/cache"]).ok()
    with With(conf, unit):
        not_started("an unmounted disk is not an empty store")
        expect(not os.listdir("/srv/data/acut/state") and not os.listdir("/srv/data/acut/cache"), "it began where no disk is mounted")
    with With(conf, unit):
        script = moved.replace("acutd --check", e2e.ACUTD + " --check")
        told_line = ". /opt/acut/tree/tests/systemd/failed\n"
        got = subprocess.run(["/bin/bash", "-euc", told_line + script], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        expect(got.returncode == 0, "ended with %d\n%s\nof:\n%s" % (got.returncode, got.stdout.decode(), script))
        expect("kept" in run([e2e.ACUTCTL, "datasets"], timeout=e2e.PATIENCE).ok().out, "the data did not come with it")
        s = settings()
        expect(s["state"]["value"] == "/srv/data/acut/state" and s["disk"]["value"] == "90%", "%s" % s["state"])
    with With(conf):
        not_started("Read-only file system")


# The installed files are read-only, so a copy is mounted over them.
run(["cp", "-a", ETC, "/run/etc-acut"]).ok()
run(["mount", "--bind", "/run/etc-acut", ETC]).ok()
systemctl("start", "acutd.socket").ok()
main(shipped, reload, disk_for_the_data)
