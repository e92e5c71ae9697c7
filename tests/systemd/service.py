"""The shipped units in a running systemd (in a container: tests/systemd/run). Started by a client, within the sandbox, killed,
stopped, reloaded, hung: clients are answered and no job is lost."""
import json
import os
import signal
import subprocess
import sys
import time

sys.path.insert(0, "/opt/acut/tree/tests/e2e")
import e2e
from e2e import Fault, Folder, expect, main, run
from held import Held

SOCKET = "/run/acut/acutd.sock"
DROPINS = "/run/systemd/system/acutd.service.d"


def ctl(*args, **kw):
    return run([e2e.ACUTCTL, "--socket", SOCKET] + list(args), **kw)


def systemctl(*args):
    return run(["systemctl", "--no-pager"] + list(args), timeout=e2e.PATIENCE)


def show(prop, unit="acutd.service"):
    return systemctl("show", "-P", prop, unit).ok().out.strip()


def pid():
    return int(show("MainPID"))


def until(what, seconds=e2e.PATIENCE):
    deadline = time.monotonic() + seconds
    while not what():
        if time.monotonic() > deadline:
            raise Fault("not within %d s: %s\n%s" % (seconds, what.__doc__ or what.__name__, systemctl("status", "acutd").out))
        time.sleep(0.02)


def journal(*match):
    run(["journalctl", "--sync"])
    return [json.loads(line) for line in run(["journalctl", "--no-pager", "-o", "json", "-b"] + list(match)).out.splitlines()]


class Dropin:
    """Lines of [Service] within a block; afterwards the service is stopped, and as before."""

    def __init__(self, *lines):
        self.lines = lines

    def __enter__(self):
        os.makedirs(DROPINS, exist_ok=True)
        with open(DROPINS + "/test.conf", "w") as f:
            f.write("[Service]\n" + "\n".join(self.lines) + "\n")
        systemctl("daemon-reload").ok()
        systemctl("stop", "acutd.service").ok()

    def __exit__(self, *exc):
        os.unlink(DROPINS + "/test.conf")
        systemctl("daemon-reload").ok()
        systemctl("stop", "acutd.service")
        systemctl("reset-failed")
        systemctl("start", "acutd.socket").ok()


def survey(points, seed=1):
    path = "/srv/s%d-%d.las" % (points, seed)
    if not os.path.exists(path):
        run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), path]).ok()
    return path


def started_by_a_connect():
    systemctl("start", "acutd.socket").ok()
    expect(show("ActiveState") == "inactive", "the service runs before anybody came")
    expect(not os.path.exists("/var/lib/acut"), "the state is there before the first start")
    asked = time.monotonic()
    ctl("ping").ok()
    print("     connect to answer at the very first start: %.2f s" % (time.monotonic() - asked))
    until(lambda: show("ActiveState") == "active" and show("StatusText") == "Serving") # systemd may notice it after the client
    expect(os.path.exists("/var/lib/acut/acut-state"), "no store was made")
    expect(os.stat("/var/lib/acut").st_mode & 0o777 == 0o700 and os.stat("/var/cache/acut").st_mode & 0o777 == 0o700,
           "folders that others look into")


def within_its_sandbox():
    ctl("ping").ok()
    p = pid()
    with open("/proc/%d/status" % p) as f:
        status = dict(line.rstrip("\n").split(":\t", 1) for line in f if ":\t" in line)
    user = run(["id", "-u", "acut"]).out.strip()
    expect(status["Uid"].split() == [user] * 4 and user != "0", "user %s" % status["Uid"])
    for which in ("CapBnd", "CapEff", "CapPrm", "CapAmb"):
        expect(int(status[which], 16) == 0, "%s %s" % (which, status[which]))
    expect(status["NoNewPrivs"] == "1" and status["Seccomp"] == "2", "no new privileges %s, seccomp %s" % (status["NoNewPrivs"], status["Seccomp"]))

    def inside(*command):
        return run(["nsenter", "-t", str(p), "-m", "-n"] + list(command)).status == 0

    for path in ("/etc", "/usr", "/var", "/srv", "/root", "/home", "/boot"):
        expect(not os.path.isdir(path) or not inside("mkdir", path + "/acut-was-here"), "%s can be written to" % path)
    for path in ("/var/lib/acut", "/var/cache/acut", "/tmp"):
        expect(inside("mkdir", path + "/acut-was-here") and inside("rmdir", path + "/acut-was-here"), "%s cannot be written to" % path)
    links = open("/proc/%d/net/dev" % p).read()
    expect(os.readlink("/proc/%d/ns/net" % p) != os.readlink("/proc/self/ns/net"), "the network of the machine")
    expect([line.split(":")[0].strip() for line in links.splitlines()[2:]] == ["lo"], "a network: %s" % links)


def same_mesh_as_outside():
    path = survey(60000)
    ctl("push", "site", path).ok()
    got = json.loads(ctl("submit", "site", "--wait", "--json").ok().out)["digest"]
    with Folder() as base, e2e.Daemon(base, memory="64M") as d:
        d.ctl("push", "site", path).ok()
        want = json.loads(d.ctl("submit", "site", "--wait", "--json").ok().out)["digest"]
    expect(got == want, "%s in the sandbox, %s outside" % (got, want))


def python_finds_it():
    """The module and the library are found as installed below /usr/local, without settings."""
    code = "import acut\nwith acut.connect() as server: print(*(d.name for d in server.datasets()))"
    got = run(["env", "-i", "-C", "/", "PATH=/usr/bin:/bin", "/usr/bin/python3", "-c", code], timeout=e2e.PATIENCE).ok()
    expect(got.out.split() == ["site"], got.out)


def killed_and_started_again():
    """kill -9 during jobs, with clients that connect at that moment: the socket stays, and all are answered."""
    path, inode, worst = survey(60000), os.stat(SOCKET).st_ino, 0.0
    restarts = int(show("NRestarts"))
    for _ in range(3):
        submitted = ctl("submit", "site", "--new", "--json").ok().json()
        before = pid()
        os.kill(before, signal.SIGKILL)
        killed = time.monotonic()
        clients = [subprocess.Popen([e2e.ACUTCTL, "--socket", SOCKET, "ping"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
                   for _ in range(8)]
        for c in clients:
            expect(c.wait(e2e.PATIENCE) == 0, "a client who waited: %d %s" % (c.returncode, c.stderr.read()))
        worst = max(worst, time.monotonic() - killed)
        expect(pid() not in (0, before), "not started again")
        ctl("wait", str(submitted["job"])).ok()
    expect(int(show("NRestarts")) - restarts == 3, "%s restarts" % show("NRestarts"))
    expect(os.stat(SOCKET).st_ino == inode, "the socket is another one")
    print("     kill -9 to the answer of the last of 8 clients: %.2f s at most" % worst)


def stopped_with_work():
    """A stop during jobs takes seconds. The next client starts acutd again, and the jobs continue."""
    ctl("push", "large", survey(1500000)).ok()
    # Several views, so that no job uses the domains of another: they must take longer than the time until the stop.
    jobs = [ctl("submit", "large", "--zmin", str(-1000 - i), "--json").ok().json()["job"] for i in range(40)]
    until(lambda: "running" in show("StatusText"))
    begun = time.monotonic()
    systemctl("stop", "acutd.service").ok()
    took = time.monotonic() - begun
    # If TimeoutStopSec had ended it, the result would be another.
    expect(show("Result") == "success" and show("ActiveState") == "inactive", "stopped in %.1f s: %s" % (took, show("Result")))
    state = ctl("show", str(jobs[-1]), "--json").ok().json()["state"]
    expect(state != "done", "the last job was done before the stop")
    ctl("cancel", *map(str, jobs[2:])).ok()
    ctl("wait", *map(str, jobs[:2])).ok()
    begun = time.monotonic()
    systemctl("restart", "acutd.service").ok()
    ctl("ping").ok()
    print("     stop with a job under way: %.1f s; restart to answer: %.1f s" % (took, time.monotonic() - begun))


def reloaded():
    before, since = pid(), time.time()
    systemctl("reload", "acutd.service").ok()
    ctl("ping").ok()
    until(lambda: [e for e in journal("_SYSTEMD_UNIT=acutd.service") if "9cbdd8c702e747389fcea45d41e6cc4f" == e.get("MESSAGE_ID") and
                   int(e["__REALTIME_TIMESTAMP"]) / 1e6 >= since - 1])
    expect(pid() == before and show("ActiveState") == "active", "a reload is a restart")


def signs_of_life(n):
    """Waits for so many more watchdog messages."""
    for _ in range(n):
        last = show("WatchdogTimestampMonotonic")
        until(lambda: show("WatchdogTimestampMonotonic") != last)


def hung_and_killed():
    """The watchdog ends a loop that hangs, and no idle one."""
    with Dropin("WatchdogSec=10s", "TimeoutAbortSec=2s"):
        ctl("ping").ok()
        before = pid()
        signs_of_life(1)
        expect(pid() == before, "an idle daemon was ended by its watchdog")
        os.kill(before, signal.SIGSTOP)
        begun = time.monotonic()
        until(lambda: pid() not in (0, before))
        ctl("ping").ok()
        print("     hung to answering again: %.1f s" % (time.monotonic() - begun))
        expect([e for e in journal("UNIT=acutd.service") if "Watchdog timeout" in str(e.get("MESSAGE"))], "it was not the watchdog")


def slow_disk_is_no_hang():
    """An fsync that takes longer than the watchdog does not end acutd."""
    path = survey(60000, 2)
    with Dropin("WatchdogSec=8s"):
        ctl("ping").ok()
        before = pid()
        held = Held(before, "/srv/held")
        push = subprocess.Popen([e2e.ACUTCTL, "--socket", SOCKET, "push", "slow", path], stdout=subprocess.DEVNULL)
        held.wait()
        signs_of_life(3)
        expect(push.poll() is None, "the push has ended, with its fsync not done")
        held.let_go()
        expect(push.wait(e2e.PATIENCE) == 0, "the push: %d" % push.returncode)
        expect(pid() == before and not int(show("NRestarts")), "it was killed")


def journal_has_it():
    entries = journal("SYSLOG_IDENTIFIER=acutd", "_SYSTEMD_UNIT=acutd.service")
    ids = [e.get("MESSAGE_ID") for e in entries]
    for event, text in (("a8cd7a50be474bbba14941ee2cfb940e", "start"), ("6c5a079f14bf44a5ae6dfb537c615d60", "ready"),
                        ("6258448bd150456fac1876d96965c907", "stop")):
        expect(event in ids, "no entry of a %s in %d" % (text, len(entries)))


def memory_is_one_number():
    """An unset memory is the limit of the control group less 48 MiB. The container's kernel has no such limit: acutd reads a tree
    of files in its place."""
    ctl("ping").ok()
    with open("/proc/%d/cgroup" % pid()) as f:
        group = [line.strip().split(":", 2) for line in f]
    memory = [g for number, which, g in group if which in ("", "memory")]
    for top in ("/srv/cgroup", "/srv/cgroup/memory"):
        for g in memory:
            os.makedirs(top + g, exist_ok=True)
            for name in ("memory.max", "memory.limit_in_bytes"):
                with open("%s%s/%s" % (top, g, name), "w") as f:
                    f.write("%d\n" % (512 << 20))
    with Dropin("BindReadOnlyPaths=/srv/cgroup:/sys/fs/cgroup", "MemoryMax=512M"):
        status = ctl("status", "--json").ok().json()
        expect(status["memory"] == (512 - 48) << 20, "the memory is %d" % status["memory"])
    with Dropin("BindReadOnlyPaths=/srv/cgroup:/sys/fs/cgroup", "MemoryMax=512M", "ExecStart=",
                "ExecStart=/usr/local/bin/acutd --init-first --memory 600M", "Restart=no"):
        expect(systemctl("start", "acutd.service").status != 0, "more memory than the control group has")


def strangers_are_refused():
    """Members of the group are served; others end with 77 and the reason. The daemon sees the real numbers of both."""
    gid = run(["getent", "group", "acut"]).out.split(":")[2]
    stranger = ["setpriv", "--reuid=12345", "--regid=12345"]
    with Dropin("ExecStart=", "ExecStart=/usr/local/bin/acutd --init-first --group acut --admin-group acut-admin"):
        ask = [e2e.ACUTCTL, "--socket", SOCKET, "push", "theirs", survey(1000)]
        os.chmod(survey(1000), 0o644)
        got = run(stranger + ["--clear-groups"] + ask)
        expect(got.status == 77 and got.err, "a stranger: %d %s" % (got.status, got.err))
        run(stranger + ["--groups", gid] + ask).ok()
        until(lambda: [e for e in journal("SYSLOG_IDENTIFIER=acutd") if "12345" in str(e.get("MESSAGE")) + str(e.get("ACUT_USER"))])


def verified_weekly():
    systemctl("start", "acut-verify.timer").ok()
    expect(show("NextElapseUSecRealtime", "acut-verify.timer"), "the timer does not run")
    systemctl("start", "acut-verify.service").ok()
    expect(show("Result", "acut-verify.service") == "success", systemctl("status", "acut-verify").out)


def found_by_its_fields():
    """journalctl finds a job by its number, and explains the event from the catalogue."""
    ctl("push", "fields", survey(3000, 7)).ok()
    run([e2e.ACUTCTL, "--socket", SOCKET, "submit", "fields", "--wait", "--ground", "--zmin", "100000", "--json"])
    until(lambda: journal("-t", "acutd", "ACUT_DATASET=fields", "ACUT_EVENT=JOB_FAILED"))
    failed = journal("-t", "acutd", "ACUT_DATASET=fields", "ACUT_EVENT=JOB_FAILED")
    expect(len(failed) == 1 and failed[0]["_SYSTEMD_UNIT"] == "acutd.service", "the failure: %s" % failed)
    entry = failed[0]
    expect(entry["PRIORITY"] == "4" and entry["ACUT_USER"] == "0" and entry["ACUT_CODE"] == "bad-input", str(entry))
    of_job = journal("ACUT_JOB=" + entry["ACUT_JOB"])
    expect([e["ACUT_EVENT"] for e in of_job] == ["JOB_FAILED"], "of the job: %s" % of_job)
    pushed = journal("-t", "acutd", "ACUT_DATASET=fields", "ACUT_EVENT=PUSH_COMMITTED")
    expect(len(pushed) == 1 and pushed[0]["ACUT_GENERATION"] == "1", str(pushed))
    expect(not [e for e in journal("-u", "acutd.service", "_TRANSPORT=stdout") if e.get("SYSLOG_IDENTIFIER") == "acutd" and
                "job " in str(e.get("MESSAGE"))], "entries come as lines, too")
    run(["journalctl", "--update-catalog"]).ok()
    told = run(["journalctl", "--no-pager", "-x", "-t", "acutd", "ACUT_JOB=" + entry["ACUT_JOB"]]).ok().out
    expect("Subject: a job failed" in told and "what helps" in told, told)


def watched_by_a_timer():
    """The metrics are a file that everybody may read, written each minute, also when acutd does not answer. doctor finds nothing
    wrong."""
    systemctl("start", "acut-metrics.timer").ok()
    systemctl("start", "acut-metrics.service").ok()
    path = "/run/acut-metrics/acut.prom"
    with open(path) as f:
        text = f.read()
    expect("\nacut_up 1\n" in text and 'acut_dataset_points{dataset="fields",uid="0",user="root"} 3000' in text, text)
    mode = os.stat(path)
    expect(mode.st_mode & 0o777 == 0o644 and os.stat("/run/acut-metrics").st_mode & 0o777 == 0o755, "mode %o" % mode.st_mode)
    expect(show("Result", "acut-metrics.service") == "success", systemctl("status", "acut-metrics").out)
    got = ctl("doctor", "--json")
    checks = {c["name"]: c for c in json.loads(got.out)["checks"]}
    expect(got.status == 0, "%d: %s" % (got.status, [c for c in checks.values() if c["state"] != "ok"]))
    expect({checks[n]["state"] for n in ("socket", "rights", "group", "memory", "files", "clock", "damage", "catalogue")} == {"ok"}, got.out)
    systemctl("stop", "acut-metrics.timer", "acut-metrics.service").ok()
    systemctl("stop", "acutd.socket", "acutd.service").ok()
    systemctl("start", "acut-metrics.service")
    with open(path) as f:
        text = f.read()
    expect("\nacut_up 0\n" in text and "dataset" not in text, "down: " + text)
    got = ctl("doctor")
    expect(got.status == 69 and "wrong" in got.out, "%d %s" % (got.status, got.out))
    systemctl("reset-failed")
    systemctl("start", "acutd.socket").ok()


def missing_disk_is_no_first_start():
    """The state folder is empty, as if its disk were not mounted: no new store is made, the start fails with the reason, and the
    store is served when it is back."""
    systemctl("stop", "acutd.socket", "acutd.service").ok()
    os.rename("/var/lib/acut", "/srv/away")
    got = systemctl("start", "acutd.service")
    expect(got.status != 0 and not os.listdir("/var/lib/acut"), "it starts: %s" % os.listdir("/var/lib/acut"))
    until(lambda: [e for e in journal("SYSLOG_IDENTIFIER=acutd") if "unmounted disk" in str(e.get("MESSAGE"))])
    # It is not restarted by itself. Each client starts it once, and gets the reason.
    expect(show("NRestarts") == "0" and show("ExecMainStatus") == "78", "%s restarts, status %s" % (show("NRestarts"), show("ExecMainStatus")))
    systemctl("reset-failed")
    systemctl("start", "acutd.socket").ok()
    starts = lambda: len([e for e in journal("SYSLOG_IDENTIFIER=acutd") if "acutd cannot start" in str(e.get("MESSAGE"))])
    before = starts()
    for _ in range(3):
        got = ctl("ping")
        expect(got.status == 74 and "unmounted disk" in got.err, "a client: %d %s" % (got.status, got.err))
    until(lambda: show("ActiveState") == "failed")
    time.sleep(1)
    expect(0 < starts() - before <= 3 and show("NRestarts") == "0", "%d starts for 3 clients" % (starts() - before))
    expect(systemctl("is-active", "acutd.socket").out.strip() == "active", "the socket is closed")
    systemctl("stop", "acutd.socket", "acutd.service")
    os.rmdir("/var/lib/acut")
    os.rename("/srv/away", "/var/lib/acut")
    systemctl("start", "acutd.socket").ok()
    expect("site" in ctl("datasets").ok().out, "the store is not back")


main(started_by_a_connect, within_its_sandbox, same_mesh_as_outside, python_finds_it, killed_and_started_again, stopped_with_work, reloaded,
     hung_and_killed, slow_disk_is_no_hang, journal_has_it, memory_is_one_number, strangers_are_refused, verified_weekly,
     found_by_its_fields, watched_by_a_timer, missing_disk_is_no_first_start)
