"""The units without a running systemd: they are well formed as installed, their permissions are as small as promised, and users
and folders are created. No privileges are needed."""
import os
import re
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "e2e"))
from e2e import Folder, expect, main, run, unavailable

# Exposure by systemd-analyze security, times ten: 0.4, and 1.0 for units with USB devices and udev's events.
THRESHOLD = 4
THRESHOLDS = {"acut-scan@1-2.4.service": 10}
SCANNERS = os.path.join(HERE, "..", "..", "etc", "scanners.d")
UNITS = ["acutd.service", "acutd.socket", "acut-verify.service", "acut-verify.timer", "acut-ingest@survey.service", "acut-ingest@survey.path",
         "acut-ingest@survey.timer", "acut-metrics.service", "acut-metrics.timer"]
if os.environ.get("ACUT_SCAN"):
    UNITS.append("acut-scan@1-2.4.service")


def staged(base):
    """A copy of the installed tree, with the system's programs that the units name."""
    stage = subprocess.run([os.path.join(HERE, "stage"), os.environ["BUILD"]], stdout=subprocess.PIPE, check=True, timeout=1800)
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
    return run(["systemd-analyze"] + list(args) + ["--no-pager"], timeout=240)


def installed_units_are_well_formed():
    with Folder() as base:
        root = staged(base)
        here = sorted(n for n in os.listdir(os.path.dirname(find(root, UNITS[0]))) if "@" not in n)
        expect({u for u in UNITS if "@" not in u} <= set(here), "installed: %s" % here)
        for unit in sorted(set(here) | set(UNITS)):
            got = analyze("verify", "--root=" + root, "--recursive-errors=no", "--man=no", unit)
            expect(got.status == 0 and not got.err.strip(), "%s: %d %s" % (unit, got.status, got.err))
        # Settings of drop folders are beside those of acutd, whatever the prefix is.
        etc = os.path.dirname(find(root, "acutd.conf"))[len(root):]
        with open(find(root, "acut-ingest@.service")) as f:
            expect("EnvironmentFile=-%s/ingest/%%i.conf\n" % etc in f.read(), "acut-ingest@.service does not read %s/ingest" % etc)
        # The check itself finds an error.
        path = find(root, "acutd.service")
        with open(path, "a") as f:
            f.write("[Service]\nPrivateDevice=yes\n")
        got = analyze("verify", "--root=" + root, "--recursive-errors=no", "--man=no", "acutd.service")
        expect(got.status != 0 and "PrivateDevice" in got.err, "a key that is not one passes")


def exposure_is_small():
    with Folder() as base:
        root = staged(base)
        for unit in (u for u in UNITS if u.endswith(".service")):
            most = THRESHOLDS.get(unit, THRESHOLD)
            got = analyze("security", "--root=" + root, "--offline=true", "--threshold=%d" % most, unit)
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
        got = run(["systemd-sysusers", "--root=" + root], timeout=240)
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
        if os.environ.get("ACUT_SCAN"):
            # The user of the capture has no right to datasets; acut-scan-push.service has it.
            expect("acut-scan" in users and users["acut-scan"][5] == "/var/lib/acut-scan" and "acut-scan" in groups, str(users))
        if os.geteuid():
            return
        run(["systemd-tmpfiles", "--root=" + root, "--create"], timeout=240).ok()
        st = os.stat(root + "/run/acut")
        expect(st.st_mode & 0o7777 == 0o755 and st.st_uid == int(users["acut"][2]), "/run/acut: %o of %d" % (st.st_mode, st.st_uid))
        expect(not os.path.exists(root + "/var/lib/acut"), "the folder of the state is made where a disk may be missing")


def matches(path):
    """The match of a profile, by another reader than acut-scan's: {attribute: value} as udev has them."""
    names = {"vendor": ("ATTR{idVendor}", "%04x"), "product": ("ATTR{idProduct}", "%04x"), "device-class": ("ATTR{bDeviceClass}", "%02x"),
             "interface-class": ("ENV{ID_USB_INTERFACES}", "*:%02x*"), "serial": ("ATTR{serial}", "%s")}
    found, section = {}, ""
    with open(path) as f:
        for line in f:
            line = line.strip()
            if line.startswith("["):
                section = line.strip("[]")
            elif section == "match" and "=" in line and line[0] not in "#;":
                key, value = (x.strip() for x in line.split("=", 1))
                name, form = names[key]
                found[name] = form % (value if key == "serial" else int(value, 0))
    return found


def rules_are_those_of_the_profiles():
    """Each profile that names a vendor has one rule with exactly its match; there are no other rules."""
    with Folder() as base:
        with open(find(staged(base), "70-acut-scanner.rules")) as f:
            lines = [line for line in f.read().splitlines() if line and not line.startswith("#")]
    rules = {}
    for line in lines:
        parts = dict(re.findall(r'([A-Z_]+(?:\{\w+\})?)==?"([^"]*)"(?:, |$)', line.replace('ENV{ACUT_SCANNER}=="", ', "")))
        expect(not re.search(r'[^=]=[^="]', line), "no rule: " + line)
        if "ENV{ACUT_SCANNER}" in parts and "GOTO" not in parts:
            expect(parts.pop("SUBSYSTEM") == "usb", line)
            rules[parts.pop("ENV{ACUT_SCANNER}")] = parts
    wanted = {name[:-5]: matches(os.path.join(SCANNERS, name)) for name in os.listdir(SCANNERS) if name.endswith(".conf")}
    wanted = {name: found for name, found in wanted.items() if "ATTR{idVendor}" in found}
    expect(wanted and rules == wanted, "rules %s, profiles %s" % (rules, wanted))
    print("     %d rules: %s" % (len(rules), " ".join(sorted(rules))))
    # The rule gives rights, and starts a unit named by the port: for a device, not for its interfaces or its removal.
    text = "\n".join(lines)
    for part in ('ENV{DEVTYPE}!="usb_device", GOTO=', 'ACTION=="remove", GOTO=', 'GROUP="acut-scan", MODE="0660", TAG+="systemd"',
                 'ENV{ID_USB_INTERFACES}=="*:08????:*", GOTO=', 'ENV{SYSTEMD_WANTS}+="acut-scan@$kernel.service"'):
        expect(part in text, part)


def rule_of_a_profile_of_ones_own():
    """One line for udev, whatever a serial number contains; none for a profile that would match any device."""
    with Folder() as base:
        text = "[match]\nvendor = 0x1209\nserial = A|B[*]\n[usb]\nendpoint-in = 0x81\n[framer]\nkind = stream\n[decoder]\nname = xyz\n"
        for name, have in (("own", text), ("any", text.replace("vendor = 0x1209\nserial = A|B[*]", "interface-class = 0xff"))):
            with open("%s/%s.conf" % (base, name), "w") as f:
                f.write(have)
        scan = os.environ["ACUT_SCAN"]
        got = run([scan, "profiles", "--udev", "--profiles", base, "own"], timeout=240).ok().out.splitlines()
        expect(got[-1] == 'SUBSYSTEM=="usb", ENV{DEVTYPE}=="usb_device", ATTR{idVendor}=="1209", ATTR{serial}=="A?B?*?", '
               'ENV{ACUT_SCANNER}="own"', str(got))
        got = run([scan, "profiles", "--udev", "--profiles", base], timeout=240).ok().out
        expect("(no rule: it names no vendor)" in got and got.count('}="') == 1 + 0, got)
        with open(base + "/own.conf", "a") as f:
            f.write("nonsense\n")
        got = run([scan, "profiles", "--udev", "--profiles", base], timeout=240)
        expect(got.status == 1 and "own.conf" in got.err, "rules of a broken profile: %d %s" % (got.status, got.out))


CASES = [installed_units_are_well_formed, exposure_is_small, users_and_folders]
if os.environ.get("ACUT_SCAN"):
    CASES += [rules_are_those_of_the_profiles, rule_of_a_profile_of_ones_own]
if not shutil.which("systemd-analyze"):
    unavailable("systemd-analyze is not installed")
main(*CASES)
