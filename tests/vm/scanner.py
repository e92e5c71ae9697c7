"""Scanners on a real kernel: udev, usbfs and systemd, the shipped rules and the shipped unit; the devices are programs behind
dummy_hcd (tests/usb/fake_gadget.c). Runs as root in the machine that `run` boots; names as arguments run these cases only.

What a capture holds is compared with what the device says it gave: its hash, or, where it was pulled out in the middle, its bytes.
Figures are printed as `figure NAME: VALUE`; the machine is emulated, so they are those of this machine's emulator.
"""
import glob
import json
import os
import re
import signal
import subprocess
import sys
import time

sys.path[:0] = ["/opt/acut/tree/tests/e2e", "/opt/acut/tree/tests/usb"]
from e2e import Fault, expect, main, run
from spool import Spool

SCAN = os.environ["ACUT_SCAN"]
GADGET = "/opt/acut/usb/fake-gadget"
SPOOLS = "/var/lib/acut-scan"
ETC = "/usr/local/etc/acut"
MB = 1 << 20
PROFILE = """title = Bulk stream of a test
[match]
vendor = 0x1209
product = 0x0001
[usb]
interface = 0
endpoint-in = 0x81
transfer-size = 64K
transfers = 8
[framer]
kind = line
[decoder]
name = xyz
columns = xyz
"""


def figure(name, fmt, *args):
    print("figure %s: %s" % (name, fmt % args), flush=True)


def show(unit, *props):
    out = run(["systemctl", "show", "-p", ",".join(props), unit], timeout=60).ok().out
    return dict(line.split("=", 1) for line in out.splitlines() if "=" in line)


def journal(unit):
    run(["journalctl", "--sync"])
    return run(["journalctl", "--no-pager", "-o", "cat", "-b", "-u", unit]).out


def until(what, seconds=30, every=0.1):
    """Returns the seconds that it took."""
    begun = time.monotonic()
    while True:
        got = what()
        if got:
            return time.monotonic() - begun
        if time.monotonic() - begun > seconds:
            raise Fault("not within %d s: %s\n%s\n%s" % (seconds, what.__doc__ or what.__name__, journal("acut-scan@*"),
                                                        run(["dmesg"]).out[-1500:]))
        time.sleep(every)


def unit(port="1-1"):
    return "acut-scan@%s.service" % port


def state(port="1-1"):
    return show(unit(port), "ActiveState", "Result", "NRestarts", "MainPID", "SubState")


def active(port="1-1"):
    return state(port)["ActiveState"] == "active"


def inactive(port="1-1"):
    return state(port)["ActiveState"] in ("inactive", "failed")


def spools():
    return sorted(glob.glob(SPOOLS + "/*.spool"), key=os.path.getmtime)


class Device:
    """A gadget with a script. It is plugged in within the block, or as its script says."""
    count = 0

    def __init__(self, *scripts, keep=True):
        Device.count += 1
        self.report_path, self.given = "/srv/report%d" % Device.count, "/srv/given%d" % Device.count
        self.script = "/srv/script%d" % Device.count
        with open(self.script, "w") as f:
            for i, lines in enumerate(scripts):
                f.write("device d%d\n%s%s\n" % (i, "delivered %s.%d\n" % (self.given, i) if keep else "", lines))

    def __enter__(self):
        for path in spools():
            os.unlink(path)
        self.process = subprocess.Popen([GADGET, "--report", self.report_path, self.script])
        return self

    def unplug(self):
        """Pulls it out and returns what it sent."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            self.process.wait(60)
        return self.report()

    def report(self):
        with open(self.report_path) as f:
            return json.load(f)["devices"]

    def ended(self):
        """its source is at its end"""
        try:
            return all(d["model"]["ended"] for d in self.report())
        except (OSError, ValueError):
            return False

    def gave(self, i=0):
        with open("%s.%d" % (self.given, i), "rb") as f:
            return f.read()

    def __exit__(self, *exc):
        self.unplug()
        until(inactive, 60)
        run(["systemctl", "reset-failed"])


def same_as_given(spool, model):
    """Reads a spool without acut's code; it must have an END."""
    s = Spool(spool)
    expect(s.end and not s.torn, "no END, or %d bytes torn" % s.torn)
    got = len(s.bytes())
    expect(got == model["delivered"], "%d bytes in the spool, %d given: %s" % (got, model["delivered"], s.events()))
    expect(s.sha256() == model["sha256"], "other bytes than the device gave")
    return s


def cpu(pid):
    with open("/proc/%s/stat" % pid) as f:
        fields = f.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def switches(pid):
    n = 0
    for path in glob.glob("/proc/%s/task/*/status" % pid):
        with open(path) as f:
            n += sum(map(int, re.findall(r"ctxt_switches:\s*(\d+)", f.read())))
    return n


# ---- cases ----

def plugged_in_and_captured():
    """The shipped rule and unit, the shipped profile: a TiM is plugged in, told to start, captured, silent, pulled out."""
    with Device("id 19a2:5001\nserial 4711\nmodel TiM561\nsource cola 300\nrate 20") as d:
        took = until(active, 60)
        figure("plug to a capture that runs", "%.1f s", took)
        node, = glob.glob("/dev/bus/usb/001/*[!1]") or ["?"]
        st = os.stat(node)
        expect(st.st_mode & 0o777 == 0o660 and run(["stat", "-c", "%G", node]).out.strip() == "acut-scan", "%s: %o" % (node, st.st_mode))
        s = state()
        with open("/proc/%s/status" % s["MainPID"]) as f:
            text = f.read()
        user = run(["id", "-u", "acut-scan"]).out.strip()
        expect(re.search(r"Uid:\t%s\t" % user, text) and "Seccomp:\t2" in text and re.search(r"CapBnd:\t0+\n", text), text)
        sizes = []
        for _ in range(3):
            sizes.append(os.path.getsize(spools()[0]))
            time.sleep(1.5)
        expect(sizes[0] < sizes[1] < sizes[2], "the spool does not grow: %s" % sizes)
        until(d.ended, 120, 0.3)
        time.sleep(2)
        # Silent from now on: only its own timers wake it.
        pid, before, woken, begun = s["MainPID"], cpu(s["MainPID"]), switches(s["MainPID"]), time.monotonic()
        time.sleep(20)
        span = time.monotonic() - begun
        share, wakes = (cpu(pid) - before) / span, (switches(pid) - woken) / span
        # Much of the CPU time is the emulator's, so wake-ups are counted: a loop that polls would have many.
        figure("idle with a silent device", "%.2f %% of an emulated processor, %.1f switches a second", 100 * share, wakes)
        expect(wakes < 10, "it polls: %.1f switches a second" % wakes)
        model = d.unplug()[0]["model"]
        took = until(inactive)
        figure("unplug to the end of the unit", "%.1f s", took)
        expect(state()["Result"] == "success", str(state()) + journal(unit()))
        spool, = spools()
        s = same_as_given(spool, model)
        expect(s.bytes().count(b"LMDscandata ") >= 300, "%d telegrams" % s.bytes().count(b"LMDscandata "))
        expect((s.serial, s.port, s.profile_name, s.vendor) == ("4711", "1-1", "sick-tim", 0x19a2), str(vars(s).keys()))
        with open("/proc/sys/kernel/random/boot_id") as f:
            expect(s.boot == f.read().strip(), "the boot id is %r" % s.boot)
        figure("bytes of a TiM, given and in the spool", "%d, lost 0", len(s.bytes()))


def pulled_out_and_plugged_in():
    """The device is pulled out within its stream, several times. Each spool has its END and all bytes from the bus."""
    cycles = 5
    faults = "\n".join("at %d MB unplug 6" % (2 * (i + 1)) for i in range(cycles - 1))
    with Device("source pattern %d MB\n%s" % (2 * cycles, faults)) as d:
        until(d.ended, 400, 0.3)
        time.sleep(2)
        device = d.unplug()[0]
        until(inactive)
        expect(state()["Result"] == "success", str(state()) + journal(unit()))
        expect(device["plugs"] == cycles, str(device))
        found = spools()
        expect(len(found) == cycles, "%d spools of %d plugs\n%s" % (len(found), cycles, journal(unit())))
        gave, at, missing = d.gave(), 0, 0
        for path in found:
            s = Spool(path)
            expect(s.end, "%s has no END" % path)
            got = s.bytes()
            where = gave.find(got, at)
            expect(where >= 0, "%s: not what the device gave after byte %d" % (path, at))
            missing += where - at
            at = where + len(got)
        missing += len(gave) - at
        expect(missing <= device["cut_bytes"], "%d bytes missing, %d never left the device" % (missing, device["cut_bytes"]))
        figure("plug and unplug under load", "%d cycles, %d hung, %d spools with END, %d bytes lost of what the bus had taken", cycles, 0,
               len(found), 0)


def fast():
    size = int(os.environ.get("ACUT_VM_MB", "24"))
    with Device("source pattern %d MB" % size, keep=False) as d:
        until(active, 60)
        pid, begun, first = state()["MainPID"], time.monotonic(), os.path.getsize(spools()[0])
        before = cpu(pid)
        until(lambda: os.path.getsize(spools()[0]) >= size * MB, 300, 0.05)
        span, used = time.monotonic() - begun, cpu(pid) - before
        got = (os.path.getsize(spools()[0]) - first) / span / 1e6
        figure("through usbfs into a spool with fsync", "%.1f MB/s, %.2f s of processor for %d MB", got, used, size)
        until(d.ended, 60)
        model = d.unplug()[0]["model"]
        until(inactive, 60)
        same_as_given(spools()[0], model)
        expect(len(spools()) == 1, str(spools()))
        parked = [e for e in Spool(spools()[0]).events() if e.startswith("parked")]
        figure("parked meanwhile", "%d times, %.3f s", len(parked), sum(int(e.split()[1]) for e in parked) / 1e9)


def faults():
    """Stalls, short transfers, repeated bytes, unexpected bytes, a pause: all bytes from the bus are in the spool."""
    with Device("source pattern 8 MB\nmessage 100000\nat 1 MB short 100\nat 2 MB short 0\nat 3 MB stall\nat 4 MB duplicate 512\n"
                "at 5 MB garbage 3000\nat 6 MB delay 2\nat 7 MB stall") as d:
        until(d.ended, 120, 0.3)
        time.sleep(2)
        device = d.unplug()[0]
        until(inactive)
        model, (spool,) = device["model"], spools()
        expect(all(f["fired"] == 1 for f in model["faults"]), str(model["faults"]))
        expect(device["halts"] == 2, "%d stalls" % device["halts"])
        s = same_as_given(spool, model)
        expect(s.words().count("stall") == 2 and s.words().count("cleared") == 2, str(s.events()))
        expect(state()["Result"] == "success", journal(unit()))
        figure("faults on the bus", "%d of stall, short, duplicate, garbage and delay; bytes lost 0", len(model["faults"]))


def killed():
    """After kill -9 the written bytes are readable, and the unit captures again."""
    with Device("source pattern 400 MB\nrate 2 MB") as d:
        until(active, 60)
        until(lambda: os.path.getsize(spools()[0]) > 4 * MB, 60)
        pid = state()["MainPID"]
        os.kill(int(pid), signal.SIGKILL)
        took = until(lambda: active() and state()["MainPID"] not in ("0", pid), 60)
        figure("kill -9 to a capture that runs again", "%.1f s", took)
        until(lambda: len(spools()) == 2 and os.path.getsize(spools()[1]) > 2 * MB, 60)
        expect(state()["NRestarts"] == "1", str(state()))
        d.unplug()
        until(inactive)
        first, second = (Spool(path) for path in spools())
        expect(not first.end and second.end, "END: %s %s" % (first.end, second.end))
        gave, one, two = d.gave(), first.bytes(), second.bytes()
        expect(len(one) > 4 * MB - 65536 and gave.startswith(one), "the first spool is not what the device gave")
        where = gave.find(two, len(one))
        expect(len(two) > MB and where >= 0, "the second spool is not what the device gave")
        # The transfers in flight, and the bytes in the queue.
        expect(where - len(one) <= 4 * MB, "%d bytes between the two" % (where - len(one)))
        figure("kill -9", "first spool whole to its end, %d bytes gone with the transfers in flight", where - len(one))


def stopped_by_hand():
    """After systemctl stop the spool has its END. A manual start captures again while the device is plugged in."""
    with Device("source pattern 400 MB\nrate 1 MB"):
        until(active, 60)
        until(lambda: os.path.getsize(spools()[0]) > MB, 60)
        run(["systemctl", "stop", unit()], timeout=60).ok()
        expect(state()["Result"] == "success" and Spool(spools()[0]).end, journal(unit()))
        run(["systemctl", "start", unit()], timeout=60).ok()
        until(lambda: len(spools()) == 2 and os.path.getsize(spools()[1]) > MB // 2, 60)


def two_alike():
    """Two equal devices, told apart by port and serial: a unit and a spool each."""
    with Device("serial A1\nsource pattern 3 MB\nseed 1", "serial B2\nsource pattern 3 MB\nseed 2") as d:
        until(d.ended, 120, 0.3)
        time.sleep(2)
        ports = [p for p in ("1-1", "2-1") if active(p)]
        expect(len(ports) == 2, "%s\n%s" % (ports, journal("acut-scan@*")))
        models = [device["model"] for device in d.unplug()]
        for port in ports:
            until(lambda: inactive(port))
        for model, serial in zip(models, ("A1", "B2")):
            spool, = (p for p in spools() if "-%s-" % serial in p)
            same_as_given(spool, model)


def without_a_rule():
    """A device of a profile that has no rule: nothing starts, and acut-scan says which rule is missing."""
    with Device("id 1209:0002\nsource pattern 1 MB"):
        until(lambda: glob.glob("/sys/bus/usb/devices/1-1"), 60)
        run(["udevadm", "settle"], timeout=60)
        time.sleep(1)
        expect(not active(), "it was started")
        profile = "/srv/other.conf"
        with open(profile, "w") as f:
            f.write(PROFILE.replace("product = 0x0001", "product = 0x0002"))
        got = run(["runuser", "-u", "acut-scan", "--", SCAN, "record", "--device", "port:1-1", "--profile", profile, "-o", "/tmp/none.spool"],
                  timeout=60)
        expect(got.status == 77, "%d %s" % (got.status, got.err))
        expect("udev" in got.err and "1209" in got.err and "0002" in got.err, got.err)
        expect(not os.path.exists("/tmp/none.spool"), "a spool was made")
        print("     " + got.err.strip().replace("\n", "\n     "))


class Stick:
    """Mass storage, by the kernel's own gadget, on the second port."""
    folder = "/sys/kernel/config/usb_gadget/stick"

    def write(self, name, text):
        with open(self.folder + "/" + name, "w") as f:
            f.write(text)

    def __enter__(self):
        run(["mount", "-t", "configfs", "none", "/sys/kernel/config"])
        run(["modprobe", "usb_f_mass_storage"]).ok()
        run(["cp", "/opt/acut/usb/stick.img", "/srv/stick.img"]).ok()
        for name in ("", "strings/0x409", "configs/c.1", "functions/mass_storage.0"):
            os.makedirs(os.path.join(self.folder, name), exist_ok=True)
        for name, text in (("idVendor", "0x1209"), ("idProduct", "0x0001"), ("strings/0x409/serialnumber", "S1"),
                           ("functions/mass_storage.0/lun.0/removable", "1"), ("functions/mass_storage.0/lun.0/file", "/srv/stick.img")):
            self.write(name, text)
        os.symlink(self.folder + "/functions/mass_storage.0", self.folder + "/configs/c.1/f")
        self.write("UDC", "dummy_udc.1")
        return self

    def __exit__(self, *exc):
        self.write("UDC", "\n")
        os.unlink(self.folder + "/configs/c.1/f")
        for name in ("functions/mass_storage.0", "configs/c.1", "strings/0x409", ""):
            os.rmdir(os.path.join(self.folder, name))


def mass_storage_is_left_alone():
    """A stick is not captured even if a rule calls it a scanner. The example script puts its survey into a drop folder."""
    examples = "/usr/local/share/doc/acut-scanner/examples/"
    with open(examples + "acut-storage@.service") as f:
        text = f.read().replace("/usr/local/lib/acut/", examples)
    with open("/etc/systemd/system/acut-storage@.service", "w") as f:
        f.write(text)
    run(["cp", examples + "72-acut-storage.rules", "/etc/udev/rules.d/"]).ok()
    run(["systemctl", "daemon-reload"]).ok()
    run(["udevadm", "control", "--reload"]).ok()
    drop = "/var/lib/acut-ingest/survey"
    run(["install", "-d", "-o", "acut-ingest", "-g", "acut-ingest", "-m", "2770", drop]).ok()
    for path in spools():
        os.unlink(path)
    with Stick():
        until(lambda: glob.glob("/dev/sd?"), 60)
        copied = drop + "/scans_valley.las"
        until(lambda: os.path.exists(copied), 60)
        st = os.stat(copied)
        group = run(["stat", "-c", "%G", copied]).out.strip()
        expect(st.st_mode & 0o040 and group == "acut-ingest" and st.st_size > 500000, "%o %s %d" % (st.st_mode, group, st.st_size))
        expect(os.listdir(drop) == ["scans_valley.las"], str(os.listdir(drop)))
        got = run([SCAN, "record", "--device", "port:2-1", "-o", "/srv/none.spool"], timeout=60)
        expect(got.status == 2 and "mass storage" in got.err, "%d %s" % (got.status, got.err))
        listed = [json.loads(line) for line in run([SCAN, "list", "--all", "--json"], timeout=60).ok().out.splitlines()]
        expect(any(d.get("mass_storage") for d in listed), str(listed))
        expect(state("2-1")["ActiveState"] == "inactive" and not spools(), journal("acut-scan@*"))
        driver = os.path.basename(os.readlink("/sys/bus/usb/devices/2-1:1.0/driver"))
        expect(driver == "usb-storage", "the driver is now " + driver)


def prepare():
    run(["modprobe", "dummy_hcd", "is_high_speed=1", "num=2"]).ok()
    run(["modprobe", "-a", "libcomposite", "usb_f_fs"]).ok()
    # A profile of the administrator with its rule, as in acut-scanners.d(5).
    run(["cp", "-a", ETC, "/run/etc-acut"]).ok()
    run(["mount", "--bind", "/run/etc-acut", ETC]).ok()
    os.makedirs(ETC + "/scanners.d", exist_ok=True)
    with open(ETC + "/scanners.d/test.conf", "w") as f:
        f.write(PROFILE)
    rule = run([SCAN, "profiles", "--udev", "test"]).ok().out
    os.makedirs("/etc/udev/rules.d", exist_ok=True)
    with open("/etc/udev/rules.d/69-acut-local.rules", "w") as f:
        f.write(rule)
    run(["udevadm", "control", "--reload"]).ok()


CASES = [plugged_in_and_captured, fast, pulled_out_and_plugged_in, faults, killed, stopped_by_hand, two_alike, without_a_rule,
         mass_storage_is_left_alone]
prepare()
main(*[c for c in CASES if not sys.argv[1:] or c.__name__ in sys.argv[1:]])
