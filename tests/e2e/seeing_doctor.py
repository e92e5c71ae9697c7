"""`acutctl doctor`: each check finds the problem that it is there for."""
import os
import re
import shutil
import signal
import socket
import subprocess
import time

import e2e
import resume
from e2e import expect
from seeing import apart, as_other, files_below, flip, metrics, mount, survey, total, value


def doctor(d, want, env=None, ctl=None, **states):
    """The checks by name; those in `states` have that state and say why and what to do, others are ok or of this machine."""
    run = ctl("doctor", "--json") if ctl else d.ctl("doctor", "--json", env=env)
    expect(run.status == want, "doctor ended with %d, not %d\n%s%s" % (run.status, want, run.out, run.err))
    got = run.json()
    checks = {}
    for c in got["checks"]:
        if c["name"] not in checks or c["state"] != "ok":
            checks[c["name"]] = c
    for name, state in states.items():
        expect(name in checks and checks[name]["state"] == state, "%s is not %s: %s" % (name, state, checks.get(name)))
        if state in ("warning", "wrong"):
            expect(len(checks[name]["message"]) > 10 and (checks[name]["hint"] or name == "start"), "no hint: %s" % checks[name])
    for name, c in checks.items():
        if name not in states and name not in ("time", "start"):
            slow = re.match(r"acutd took (\d+\.\d) seconds to answer", c["message"])  # a busy machine
            expect(c["state"] == "ok" or (name in ("verify", "state", "cache") or slow and float(slow[1]) >= 1) and c["state"] == "warning",
                   "%s: %s" % (name, c))
    expect(got["wrong"] == len([c for c in got["checks"] if c["state"] == "wrong"]), "number of wrong ones")
    text = ctl("doctor") if ctl else d.ctl("doctor", env=env)
    expect(text.status == want and all(c["name"] in text.out for c in got["checks"]), text.out)
    return checks


def doctor_finds_the_socket():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        checks = doctor(d, 0, socket="ok", version="ok", rights="ok", group="ok", files="ok", damage="ok", log="ok")
        expect("administrator" in checks["rights"]["message"], checks["rights"])
        sock = d.socket
        d.stop()
        expect("there is no socket" in doctor(d, 69, socket="wrong")["socket"]["message"], "absent")
        s = socket.socket(socket.AF_UNIX)
        s.bind(sock)
        s.close()
        expect("no process listens" in doctor(d, 69, socket="wrong")["socket"]["message"], "stale")
        os.unlink(sock)
        open(sock, "w").close()
        expect("is no socket" in doctor(d, 69, socket="wrong")["socket"]["message"], "file")


def doctor_tells_who_may_not():
    if os.getuid():
        print("skipped: not root")
        return
    with e2e.Folder() as base, e2e.Daemon(base, args=["--group", "daemon"]) as d:
        os.chmod(base, 0o755)
        os.chmod(d.socket, 0o666)
        checks = doctor(d, 77, ctl=lambda *a: as_other(d, *a), rights="wrong")
        expect("group daemon" in checks["rights"]["message"] and "usermod" in checks["rights"]["hint"], checks["rights"])
        os.chmod(d.socket, 0o600)
        expect(as_other(d, "doctor").status == 77, "no rights on the socket")
        doctor(d, 0, group="ok")


def doctor_sees_the_disk():
    with e2e.Folder() as base, e2e.Daemon(base, args=["--keep-free", "1000T"]) as d:
        checks = doctor(d, 1, state="wrong", cache="wrong")
        expect("have to stay free" in checks["state"]["message"] and "cache gc" in checks["state"]["hint"], checks["state"])
    with e2e.Folder() as base:
        with e2e.Daemon(base, args=["--disk", "16M"]) as d:
            d.ctl("push", "vol", survey(base)).ok()
            doctor(d, 0, state="ok")
            d.stop()
        # Pushed data that is there already: a quota that was lowered.
        used = os.path.getsize(files_below(d.state, lambda n: n.endswith(".seg"))[0])
        with e2e.Daemon(base, args=["--disk", "%d" % used]) as d:
            checks = doctor(d, 1, state="wrong", cache="wrong")
            expect("the quota of " in checks["state"]["message"] and "is used up" in checks["state"]["message"], checks["state"])


def doctor_counts_inodes():
    """Too few are left for anything to be pushed; then a fiftieth of them is."""
    def child():
        for inodes, used, want, says in ((900, 0, "wrong", "inodes are free"), (60000, 58900, "warning", "of 60000 inodes are free"),
                                         (60000, 0, "ok", "are free for")):
            with e2e.Folder() as base:
                os.mkdir(base + "/state")
                mount(base + "/state", "size=256m,nr_inodes=%d" % inodes)
                with e2e.Daemon(base) as d:
                    os.mkdir(base + "/state/other")
                    for i in range(used):
                        os.mknod("%s/state/other/%d" % (base, i))
                    checks = doctor(d, 1 if want == "wrong" else 0, state=want)
                    expect(says in checks["state"]["message"] and (want == "ok" or "inodes" in checks["state"]["hint"]), checks["state"])
                subprocess.run(["umount", "-l", base + "/state"], check=True)
    apart("a file system with few inodes", child)


def doctor_asks_the_control_group():
    """What its control group allows, less than the threads that it has, and more."""
    def child():
        mount("/sys/fs/cgroup", "size=1m")
        with open("/proc/self/cgroup") as f:
            lines = [line.rstrip().split(":", 2) for line in f]
        # Of whichever version this machine has it.
        for _, controllers, path in lines:
            for place in (["/sys/fs/cgroup" + path] if not controllers else []) + (
                    ["/sys/fs/cgroup/pids" + path] if "pids" in controllers.split(",") else []):
                os.makedirs(place, exist_ok=True)
                places.append(place + "/pids.max")
        for most, want, says in (("max", "ok", "no control group limits them"), ("5", "warning", "allows 5 tasks"), ("320", "ok", "of 320 tasks")):
            for place in places:
                with open(place, "w") as f:
                    f.write(most + "\n")
            with e2e.Folder() as base, e2e.Daemon(base) as d:
                checks = doctor(d, 0, tasks=want)
                expect(says in checks["tasks"]["message"] and (want == "ok" or "TasksMax" in checks["tasks"]["hint"]), checks["tasks"])
    places = []
    apart("control groups", child)


def doctor_remembers_the_verification():
    with e2e.Folder() as base:
        with e2e.Daemon(base) as d:
            d.ctl("push", "vol", survey(base)).ok()
            expect(doctor(d, 0, verify="warning")["verify"]["message"] == "what is stored was never verified", "never")
            begun = time.time()
            d.ctl("cache", "verify").ok()
            expect("verified: " in d.log_text(), "not told")
            doctor(d, 0, verify="ok")
            when = total(d, "acut_last_verify_timestamp_seconds")
            expect(begun - 1 < when < time.time() + 1, "when")
            d.stop()
            d.start()
            doctor(d, 0, verify="ok")
            expect(abs(total(d, "acut_last_verify_timestamp_seconds") - when) < 1, "forgotten")
            for p in files_below(d.state, lambda n: n.endswith(".seg")):
                flip(p, 40000)
            expect(d.ctl("cache", "verify").status == 1, "whole")
            doctor(d, 1, verify="wrong", damage="wrong")
            expect(total(d, "acut_last_verify_damaged", data="pushed") == 1 == total(d, "acut_checksum_errors_total", data="pushed"), "")
            d.stop()
            d.start()
            # There was no new damage since, but the old one is known.
            doctor(d, 1, verify="wrong", damage="ok")
            # A line that is cut short counts as none.
            d.stop()
            os.truncate(os.path.join(d.state, "last-verify"), 20)
            d.start()
            doctor(d, 0, verify="warning")
            # And one that is old is told.
            d.stop()
            with open(os.path.join(d.state, "last-verify"), "w") as f:
                f.write("acut-verified 1 %d 3 4000 0 0 .\n" % ((time.time() - 40 * 86400) * 1e6))
            d.start()
            expect("40 days" in doctor(d, 0, verify="warning")["verify"]["message"], "days")


def doctor_counts_files():
    with e2e.Folder() as base:
        d = e2e.Daemon(base, prefix=["/bin/sh", "-c", 'ulimit -n 50; exec "$0" "$@"'])
        with d:
            expect("LimitNOFILE" in doctor(d, 1, files="wrong")["files"]["hint"], "hint")


def doctor_reads_the_grids():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        with open(os.path.join(d.state, "geoids", "bad.geoid"), "w") as f:
            f.write("nonsense\n")
        names = [n for n in os.listdir(os.path.join(d.state, "geoids"))]
        run = d.ctl("geoid", "list")
        if not run.out and "bad" not in d.log_text():
            ending = [n for n in names if n != "bad.geoid"]
            raise e2e.Fault("the ending of names of grids is another one: %s" % ending)
        expect("bad" in doctor(d, 1, geoids="wrong", log="ok")["geoids"]["message"], "which")


CLOCK = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>
int clock_gettime(clockid_t id, struct timespec *t)
{
	static int (*real)(clockid_t, struct timespec *);
	if (!real)
		real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
	int r = real(id, t);
	if (id == CLOCK_REALTIME)
		t->tv_sec += atoi(getenv("CLOCK_SHIFT"));
	return r;
}
"""


def doctor_compares_clocks():
    if e2e.sanitized():
        print("skipped: a sanitizer comes before a preload")
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        source, lib = os.path.join(base, "clock.c"), os.path.join(base, "clock.so")
        with open(source, "w") as f:
            f.write(CLOCK)
        e2e.run(["cc", "-shared", "-fPIC", "-o", lib, source]).ok()
        env = {"LD_PRELOAD": lib, "CLOCK_SHIFT": "-3600"}
        told = doctor(d, 0, env=env, clock="warning")["clock"]["message"]
        expect(3600 <= int(re.search(r"differ by (\d+) seconds", told)[1]) < 3600 + e2e.PATIENCE, told)  # and what the question took
        d.stop()
        d.env.update(LD_PRELOAD=lib, CLOCK_SHIFT="-1600000000")
        d.start()
        doctor(d, 1, clock="wrong")


def doctor_knows_of_interrupted_pushes():
    """A push of which a file is durable and whose client goes; six and a half days later another one."""
    if e2e.sanitized():
        print("skipped: a sanitizer comes before a preload")
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        paths = resume.tiles(base, 2)
        resume.Half(d, "vol", paths, 1).vanish()
        resume.pends(d, "vol", "1 files")
        got = metrics(d)
        expect(value(got, "acut_pushes_pending") == 1 == value(got, "acut_pushes_total", result="interrupted"), "pending")
        expect(value(got, "acut_dataset_pushes_pending", dataset="vol") == 1, "of the dataset")
        expect(value(got, "acut_user_pending_bytes", uid=str(os.getuid())) >= 16 * 3000, "bytes")
        expect("1 interrupted" in doctor(d, 0, pushes="ok")["pushes"]["message"], "told")
        source, lib = os.path.join(base, "clock.c"), os.path.join(base, "clock.so")
        with open(source, "w") as f:
            f.write(CLOCK)
        e2e.run(["cc", "-shared", "-fPIC", "-o", lib, source]).ok()
        d.stop()
        env = {"LD_PRELOAD": lib, "CLOCK_SHIFT": str(int(6.5 * 86400))}
        d.env.update(env)
        d.start()
        resume.Half(d, "more", paths, 1).vanish()
        e2e.until(lambda: value(metrics(d), "acut_pushes_pending") == 2, "not pending")
        expect("2 interrupted pushes wait, the first is removed in 12 hours" in
               doctor(d, 0, env=env, pushes="warning")["pushes"]["message"], "when")


def doctor_names_a_file_that_hangs():
    """A read that does not return: the client can leave at once, others push and mesh while a worker is free, and doctor names the file."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        with e2e.Daemon(base, env=gate.env, threads=2) as d:
            good, hangs = survey(base), os.path.join(base, "hangs.las")
            shutil.copy(good, hangs)
            gate.close("pread", "hangs", 0, "acutd")
            begun = time.monotonic()
            p = subprocess.Popen([e2e.ACUTCTL, "push", "stuck", hangs], env={**os.environ, "ACUT_SOCKET": d.socket},
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            gate.wait()
            pushes = lambda: [c for c in d.ctl("doctor", "--json").json()["checks"] if c["name"] == "pushes"][0]
            expect(pushes()["state"] == "ok" or time.monotonic() - begun >= 15, "at once")
            d.ctl("push", "other", good, timeout=e2e.PATIENCE).ok()
            d.ctl("submit", "other", "--wait", timeout=e2e.PATIENCE).ok()
            stalled = lambda: [c for c in [pushes()] if c["state"] == "warning"]
            check = e2e.until(stalled, "doctor does not see it", 1)[0]
            expect("1 pushes read" in check["message"] and hangs in check["message"] and "does not answer" in check["hint"], check)
            # Its file is still held.
            p.send_signal(signal.SIGINT)
            p.communicate(timeout=e2e.PATIENCE)
            expect(p.returncode == 130, "status %s" % p.returncode)
            expect(hangs in stalled()[0]["message"], "forgotten when its client left")
            gate.open()
            e2e.until(lambda: pushes()["state"] == "ok", "doctor still sees it", 1)


if __name__ == "__main__":
    # A file system of which something is used: more than 99 % of a tmpfs may be free.
    os.environ.setdefault("ACUT_TEST_TMP", "/var/tmp")
    e2e.main(doctor_finds_the_socket, doctor_tells_who_may_not, doctor_sees_the_disk, doctor_counts_inodes, doctor_asks_the_control_group,
             doctor_remembers_the_verification, doctor_counts_files, doctor_reads_the_grids, doctor_compares_clocks,
             doctor_knows_of_interrupted_pushes, doctor_names_a_file_that_hangs)
