"""Admission: users, priorities, reported waits, and short memory. The tests count jobs and domains, not seconds."""
import json
import os
import re
import shutil
import subprocess

import e2e
from e2e import Daemon, Folder, expect

MIB = 1 << 20


def survey(base, points, name="survey.las", distribution="uniform", seed=1):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--distribution", distribution, "--points", points, "--seed", seed, path]).ok()
    return path


def submit(d, *args):
    return d.ctl("submit", *args, "--new").ok().out.strip()


def job(d, number):
    return d.ctl("show", number, "--json").json()


def jobs(d):
    return [json.loads(line) for line in d.ctl("jobs", "--json").ok().out.splitlines()]


def before(d, numbers, one):
    """The number of these jobs that ended before that one, by the log."""
    ended = re.findall(r"job (\d+) of \S+ is done", d.log_text())
    return len([n for n in ended[:ended.index(one)] if n in numbers])


def priorities():
    with Folder() as base:
        gate = e2e.Gate(base)
        with Daemon(base, memory="32M", threads=1, env=gate.env) as d: # one worker: who is done first was begun first
            priorities_of(base, d, gate)


def priorities_of(base, d, gate):
    # The one of high priority is the smallest: beside another that got its slot a moment later it still ends first.
    d.ctl("push", "small", survey(base, 1000, "small.las")).ok()
    d.ctl("push", "s", survey(base, 100000)).ok()
    d.ctl("push", "huge", survey(base, 300000, "huge.las")).ok()
    for bad in ("urgent", ""):
        expect(d.ctl("submit", "s", "--priority", bad).status == 2, "--priority %r" % bad)
    expect(d.ctl("plan", "s", "--priority", "low").status == 2, "plan takes --priority")
    # No job reads a point before all are submitted.
    gate.close("pread", ".seg")
    # All that one user may have at work; the others wait.
    huge = [submit(d, "huge", "--zmin", str(i)) for i in range(2)]
    low = [submit(d, "s", "--every", str(2 + i), "--priority", "low") for i in range(12)]
    first = submit(d, "small", "--priority", "high")
    expect(job(d, first)["priority"] == "high" and job(d, low[0])["priority"] == "low", "priority is not told")
    waits = [j for j in jobs(d) if j["position"]]
    expect(len(waits) >= 11 and all(j["state"] == "queued" and j["waiting"].startswith("its turn") for j in waits), str(waits))
    expect("waits for its turn" in d.ctl("jobs").ok().out, "jobs does not say what they wait for")
    gate.open()
    d.ctl("wait", *huge, *low, first).ok()
    n = before(d, low, first)
    print("     %d of 12 came before the one" % n)
    expect(n <= 2, "%d of low priority ended before the high one" % n)
    # The same job again, with another priority, takes that.
    gate.close("pread", ".seg")
    last = submit(d, "s", "--keep-noise", "--priority", "low")
    again = d.ctl("submit", "s", "--keep-noise", "--priority", "normal").ok().out.strip()
    expect(again == last and job(d, last)["priority"] == "normal", "not changed: %s, %s" % (again, job(d, last)))
    gate.open()
    d.ctl("mesh", os.path.join(base, "survey.las"), "-o", os.path.join(base, "o.ply"), "--priority", "low").ok()


def users():
    """Root submits forty jobs, the first of them large. The job of another user is done before more than a few of them."""
    if os.getuid():
        print("     skipped: needs root, to be another user")
        return
    with Folder() as base:
        gate = e2e.Gate(base)
        with Daemon(base, memory="32M", threads=1, env=gate.env) as d: # one worker: who is done first was begun first
            users_of(base, d, gate)


def users_of(base, d, gate):
    os.chmod(base, 0o755)
    os.chmod(d.socket, 0o777)
    acutctl = shutil.copy(e2e.ACUTCTL, base)

    def other(*args):
        p = subprocess.run([acutctl] + list(args), env=dict(os.environ, ACUT_SOCKET=d.socket), user=65534,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
        return p.returncode, p.stdout.decode().strip(), p.stderr.decode()
    d.ctl("push", "s", survey(base, 20000)).ok()
    d.ctl("push", "huge", survey(base, 300000, "huge.las")).ok()
    status, _, err = other("submit", "s", "--priority", "high")
    expect(status == 77 and "only administrators" in err, "%d %s" % (status, err))
    gate.close("pread", ".seg")
    many = [submit(d, "huge", "--zmin", str(i)) for i in range(3)]
    many += [submit(d, "s", "--every", str(2 + i)) for i in range(37)]
    status, number, err = other("submit", "s", "--zmin", "0")
    expect(status == 0, err)
    gate.open()
    status, _, err = other("wait", number)
    expect(status == 0, err)
    d.ctl("wait", *many).ok()
    n = before(d, many, number)
    print("     %d of 40 came before the one" % n)
    expect(n <= 4, "%d of another user's forty came before one" % n)


def needs_more_than_the_memory():
    """Half of the points of a parabola must be in memory at once: the job is refused with the sufficient memory, and with that it
    is meshed."""
    with Folder() as base:
        path = os.path.join(base, "parabola.las")
        e2e.run([e2e.SYNTH, "--distribution", "parabola", "--points", 500000, "--seed", 3, "--origin", "0,0", path]).ok()
        out = os.path.join(base, "o.ply")
        with Daemon(base, memory="24M") as d:
            r = d.ctl("mesh", path, "-o", out, "--json")
        expect(r.status == 1 and not os.path.exists(out), "%d %s" % (r.status, r.out + r.err))
        error = json.loads((r.out + r.err).strip().splitlines()[-1])["error"]
        expect(error["code"] == "does-not-fit", str(error))
        number = re.search(r"memory=(\d+)M", error["hint"])
        expect(number, "no number: %s" % error)
        print("     24M: %s (%s)" % (error["message"], error["hint"]))
        with Daemon(base, memory=number.group(1) + "M", name="large") as d:
            d.ctl("mesh", path, "-o", out).ok()


def all_kinds_in_little():
    with Folder() as base, Daemon(base, memory="24M") as d:
        a, b = survey(base, 200000), survey(base, 60000, "b.las", seed=2)
        d.ctl("push", "s", a).ok()
        env = dict(os.environ, ACUT_SOCKET=d.socket)
        runs = []
        for i in range(5):
            runs += [["mesh", b, "-o", os.path.join(base, "m%d.ply" % i), "--every", str(1 + i)],
                     ["push", "t%d" % i, b],
                     ["submit", "s", "--wait", "--zmin", str(i)],
                     ["submit", "s", "--wait", "--every", str(2 + i), "--priority", "low"],
                     ["plan", "s", "--thin", str(3 + i)],
                     ["info", b]]
        started = [subprocess.Popen([e2e.ACUTCTL] + r, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
                   for r in runs]
        for r, p in zip(runs, started):
            out, err = p.communicate(timeout=e2e.PATIENCE)
            expect(p.returncode == 0, "%s: %d %s" % (r, p.returncode, err.decode()))
        print("     %d at once, VmHWM %.1f MiB" % (len(runs), d.vmhwm() / MIB))
        expect(d.vmhwm() <= 24 * MIB + 32 * MIB, "VmHWM %d" % d.vmhwm())


def watched():
    """Progress: points and domains only grow, nothing is complete before the end, and the remaining time is reported."""
    with Folder() as base, Daemon(base, memory="32M", threads=1) as d:
        d.ctl("push", "s", survey(base, 1000000)).ok()
        numbers = [submit(d, "s"), submit(d, "s", "--every", "2")]
        for number in numbers:
            p = d.ctl("watch", number, "--json").ok()
            lines = [json.loads(line) for line in p.out.splitlines()]
            last = None
            for line in lines:
                now = line["progress"]
                expect(now["points"] <= (now["points_total"] or now["points"]), str(line))
                if last and last["phase"] == now["phase"]:
                    expect(now["points"] >= last["points"] and now["domains"] >= last["domains"], "%s %s" % (last, now))
                expect(line["state"] != "queued" or (line["waiting"] and line["position"]), "queued, and nothing is said: %s" % line)
                expect("seconds_left" in now and (now["seconds_left"] is None or now["seconds_left"] > 0), str(now))
                last = now
            expect(lines[-1]["state"] == "done" and lines[-1]["waiting"] is None, str(lines[-1]))
            expect(last["domains"] == last["domains_total"], str(last))
            told = [line["progress"]["seconds_left"] for line in lines if line["progress"]["seconds_left"]]
            print("     %d lines, time left %s" % (len(lines), ["%.1f" % t for t in told][:6]))
        expect(d.ctl("plan", "s", "--json").ok().json()["seconds"], "plan does not know the pace")


if __name__ == "__main__":
    e2e.main(priorities, users, needs_more_than_the_memory, all_kinds_in_little, watched)
