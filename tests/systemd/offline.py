"""The units, without a running systemd: they are well formed as installed, what they may do is as little as is promised,
and users and folders come to be. No privileges are needed."""
import os
import re
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "e2e"))
from e2e import Folder, expect, main, run, unavailable

# Exposure by systemd-analyze security, times ten: 0.4.
THRESHOLD = 4
UNITS = ["acutd.service", "acutd.socket", "acut-verify.service", "acut-verify.timer", "acut-ingest@survey.service", "acut-ingest@survey.path",
         "acut-ingest@survey.timer", "acut-metrics.service", "acut-metrics.timer"]


def staged(base):
    """A copy of the installed tree, with what the units name of the system."""
    stage = subprocess.run([os.path.join(HERE, "stage"), os.environ["BUILD"]], stdout=subprocess.PIPE, check=True, timeout=300)
    root = base + "/root"
    shutil.copytree(stage.stdout.decode().strip(), root, symlinks=True)
    for folder in ("/bin", "/etc"):
        os.makedirs(root + folder, exist_ok=True)
    shutil.copy("/bin/kill", root + "/bin/kill")
    return root


def find(root, name):
    for folder, _, names in os.walk(root):
        if name in names:
            return os.path.join(folder, name)
    raise AssertionError("%s is not installed" % name)


def analyze(*args):
    return run(["systemd-analyze"] + list(args) + ["--no-pager"], timeout=60)


def installed_units_are_well_formed():
    with Folder() as base:
        root = staged(base)
        here = sorted(n for n in os.listdir(os.path.dirname(find(root, UNITS[0]))) if "@" not in n)
        expect({u for u in UNITS if "@" not in u} <= set(here), "installed: %s" % here)
        for unit in sorted(set(here) | set(UNITS)):
            got = analyze("verify", "--root=" + root, "--recursive-errors=no", "--man=no", unit)
            expect(got.status == 0 and not got.err.strip(), "%s: %d %s" % (unit, got.status, got.err))
        # Settings of drop folders lie beside those of acutd, wherever it is installed to.
        etc = os.path.dirname(find(root, "acutd.conf"))[len(root):]
        with open(find(root, "acut-ingest@.service")) as f:
            expect("EnvironmentFile=-%s/ingest/%%i.conf\n" % etc in f.read(), "acut-ingest@.service does not read %s/ingest" % etc)
        # The judge judges.
        path = find(root, "acutd.service")
        with open(path, "a") as f:
            f.write("[Service]\nPrivateDevice=yes\n")
        got = analyze("verify", "--root=" + root, "--recursive-errors=no", "--man=no", "acutd.service")
        expect(got.status != 0 and "PrivateDevice" in got.err, "a key that is not one passes")


def exposure_is_small():
    with Folder() as base:
        root = staged(base)
        for unit in ("acutd.service", "acut-verify.service", "acut-ingest@survey.service", "acut-metrics.service"):
            got = analyze("security", "--root=" + root, "--offline=true", "--threshold=%d" % THRESHOLD, unit)
            level = re.search(r"Overall exposure level for \S+: ([0-9.]+)", got.out)
            expect(level and got.status == 0, "%s: %s\n%s%s" % (unit, level and level.group(1), got.out, got.err))
            print("     %s: %s" % (unit, level.group(1)))
        path = find(root, "acutd.service")
        with open(path, "a") as f:
            f.write("[Service]\nPrivateNetwork=no\n")
        got = analyze("security", "--root=" + root, "--offline=true", "--threshold=%d" % THRESHOLD, "acutd.service")
        expect(got.status != 0, "a service with a network passes")


def users_and_folders():
    with Folder() as base:
        root = staged(base)
        got = run(["systemd-sysusers", "--root=" + root], timeout=60)
        if got.status and os.geteuid():
            unavailable("systemd-sysusers needs root here: " + got.err.strip())
        got.ok()
        with open(root + "/etc/passwd") as f:
            users = dict((line.split(":")[0], line.strip().split(":")) for line in f)
        with open(root + "/etc/group") as f:
            groups = dict((line.split(":")[0], line.strip().split(":")) for line in f)
        expect("acut" in users and users["acut"][5] == "/var/lib/acut" and users["acut"][6].endswith("nologin"), str(users))
        expect("acut" in groups and "acut-admin" in groups, str(groups))
        expect("acut-ingest" in users and groups["acut"][3] == "acut-ingest", str(groups))
        if os.geteuid():
            return
        run(["systemd-tmpfiles", "--root=" + root, "--create"], timeout=60).ok()
        st = os.stat(root + "/run/acut")
        expect(st.st_mode & 0o7777 == 0o755 and st.st_uid == int(users["acut"][2]), "/run/acut: %o of %d" % (st.st_mode, st.st_uid))
        expect(not os.path.exists(root + "/var/lib/acut"), "the folder of the state is made where a disk may be missing")


if not shutil.which("systemd-analyze"):
    unavailable("systemd-analyze is not installed")
main(installed_units_are_well_formed, exposure_is_small, users_and_folders)
