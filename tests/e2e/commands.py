"""The commands of acutctl against a real daemon: datasets, jobs, streams, refusals, exit statuses."""
import json
import os
import signal
import subprocess

import e2e
from e2e import expect

KEYS = ("job dataset generation points used vertices triangles hull domains digest vertex_digest lattice crs units "
        "removed seconds stage_seconds first_triangle_seconds peak_rss_bytes output_bytes "
        "halo points_read cells_read seal_seconds plan_seconds domains_seconds").split()


def survey(base, name="survey.las", points=200000, *options):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", points, *options, path]).ok()
    return path


def status(run, want, *texts):
    expect(run.status == want, "%s ended with %d, not %d\n%s%s" % (" ".join(run.args), run.status, want, run.out, run.err))
    for t in texts:
        expect(t in run.out + run.err, "%s does not say '%s':\n%s%s" % (" ".join(run.args), t, run.out, run.err))


def mesh_is_complete():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, out, png = survey(base), os.path.join(base, "m.ply"), os.path.join(base, "m.png")
        got = d.ctl("mesh", "--json", "-o", out, "-o", png, path).ok().json()
        for k in KEYS:
            expect(k in got, "the report has no '%s'" % k)
        expect(got["points"] == 200000 and got["used"] == got["vertices"], str(got))
        expect(got["triangles"] == 2 * got["vertices"] - 2 - got["hull"], "Euler's count")
        expect(got["output_bytes"] >= os.path.getsize(out), "output_bytes %d" % got["output_bytes"])
        with open(png, "rb") as f:
            expect(f.read(8) == b"\x89PNG\r\n\x1a\n", "not a PNG")
        e2e.run([e2e.VERIFY, out, path]).ok()
        expect(not [n for n in os.listdir(base) if ".part" in n or ".tmp" in n], str(os.listdir(base)))
        # The dataset of one step is removed in the background, once its client is gone.
        left = lambda: os.listdir(os.path.join(d.cache, "one-step"))
        e2e.until(lambda: not left(), lambda: "left in the cache: %s" % left())


def verify_catches():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, other, out = survey(base, points=5000), survey(base, "o.las", 5000, "--seed", 99), os.path.join(base, "m.ply")
        d.ctl("mesh", "-o", out, path).ok()
        e2e.run([e2e.VERIFY, out, path]).ok()
        status(e2e.run([e2e.VERIFY, out, other]), 1)
        with open(out, "r+b") as f:
            data = f.read()
            f.seek(len(data) - 4)
            f.write(b"\x01\x00\x00\x00")
        status(e2e.run([e2e.VERIFY, out, path]), 1)


def datasets_and_jobs():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        a, b = survey(base, "a.las", 60000), survey(base, "b.las", 60000, "--seed", 5)
        d.ctl("push", "valley", a).ok()
        first = int(d.ctl("submit", "valley", "--wait").ok().out.split()[0])
        again = int(d.ctl("submit", "valley").ok().out.split()[0])
        expect(first == again, "the same generation and view gave job %d, then %d" % (first, again))
        fresh = int(d.ctl("submit", "valley", "--new", "--wait").ok().out.split()[0])
        expect(fresh != first, "--new gave the old job")
        d.ctl("push", "valley", b).ok()
        second = int(d.ctl("submit", "valley", "--wait").ok().out.split()[0])
        expect(second != first, "a push made no new job")
        out = os.path.join(base, "v.ply")
        show = d.ctl("show", str(second), "--json").ok().json()
        got = d.ctl("fetch", str(second), "-o", out, "--json").ok().json()
        counted = d.ctl("fetch", str(second), "--format", "null", "--json").ok().json()
        expect(counted["digest"] == got["digest"] and counted["output_bytes"] == 0, "--format null: %s" % counted)
        one = d.ctl("mesh", "--json", "-o", os.path.join(base, "w.ply"), b, a).ok().json()
        expect(got["digest"] == one["digest"] == show["digest"], "%s %s %s" % (got["digest"], one["digest"], show["digest"]))
        expect(got["vertex_digest"] == one["vertex_digest"], "vertex digests differ")
        e2e.run([e2e.VERIFY, out, a, b]).ok()
        box = d.ctl("dataset", "show", "valley", "--json").ok().json()
        expect(box["min"][0] < box["max"][0] and box["min"][2] is None and box["max"][2] is None, str(box))
        expect(" 0 to " not in d.ctl("dataset", "show", "valley").ok().out, "a height range that nobody knows")
        names = [json.loads(line)["name"] for line in d.ctl("datasets", "--json").ok().out.splitlines()]
        expect(names == ["valley"], str(names))
        jobs = [json.loads(line)["job"] for line in d.ctl("jobs", "--json").ok().out.splitlines()]
        expect({first, fresh, second} <= set(jobs), str(jobs))
        plan = d.ctl("plan", "valley", "--json").ok().json()
        expect(plan["points"] == 120000 and plan["seconds"] is not None, str(plan))
        d.ctl("wait", str(first), str(second)).ok()
        d.ctl("rm", str(first)).ok()
        status(d.ctl("show", str(first)), 4)
        # A restart keeps datasets, jobs and meshes.
        d.stop()
        d.start()
        d.ctl("fetch", str(second), "-o", out).ok()
        e2e.run([e2e.VERIFY, out, a, b]).ok()


def domains_from_files_alone():
    """acut-domain on every region of a dataset: together they have the triangles and the digest of the daemon's mesh."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "valley", survey(base)).ok()
        job = d.ctl("submit", "valley", "--wait").ok().out.split()[0]
        want = d.ctl("show", job, "--json").ok().json()
        d.stop()
        manifests = [os.path.join(top, n) for top, _, files in os.walk(d.state) for n in files
                     if e2e.run([e2e.DOMAIN, "--plan", os.path.join(top, n), ""]).status == 0]
        expect(len(manifests) == 1, "manifests: %s" % manifests)
        out = os.path.join(base, "out")
        os.mkdir(out)
        halves, count = [0, 0], 0
        plan = e2e.run([e2e.DOMAIN, "--memory", "16M", "--plan", manifests[0], ""]).ok().out.splitlines()
        expect(len(plan) > 1, "one region only")
        for line in plan:
            words = e2e.run([e2e.DOMAIN, "--memory", "16M", manifests[0], "", line.split()[0], out]).ok().out.split()
            expect(os.path.exists(os.path.join(out, words[0])), "no domain under its name")
            count += int(words[words.index("triangles") + 1])
            digest = words[words.index("digest") + 1]
            halves = [(h + int(part, 16)) % 2**64 for h, part in zip(halves, (digest[:16], digest[16:]))]
        expect(count == want["triangles"], "%d triangles, not %d" % (count, want["triangles"]))
        expect("%016x%016x" % tuple(halves) == want["digest"], "the digests do not add up")
        status(e2e.run([e2e.DOMAIN, manifests[0], "", "rubbish", out]), 2, "rubbish")


def regions_from_files_alone():
    """acut-domain --plan has the regions of the daemon's job, and its domains are those that the daemon has stored."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "valley", survey(base, points=400000)).ok()
        job = d.ctl("submit", "valley", "--wait").ok().out.split()[0]
        d.stop()
        manifest = [os.path.join(top, n) for top, _, files in os.walk(os.path.join(d.state, "datasets")) for n in files
                    if e2e.run([e2e.DOMAIN, "--plan", os.path.join(top, n), ""]).status == 0]
        expect(len(manifest) == 1, "manifests: %s" % manifest)
        file = os.path.join(d.state, "plans", "plan-" + job)
        want = e2e.run([e2e.DOMAIN, "--job-plan", file]).ok().out
        expect(len(want.splitlines()) > 5, "few regions: %s" % want)
        for memory in "64M", "256M":
            got = e2e.run([e2e.DOMAIN, "--memory", memory, "--plan", manifest[0], ""]).ok().out
            expect(got == want, "with %s the regions are others:\n%s%s" % (memory, got, want))
        got = e2e.run([e2e.DOMAIN, "--load", "20000", "--plan", manifest[0], ""]).ok().out
        expect(len(got.splitlines()) > len(want.splitlines()), "no more regions with a smaller load")
        out = os.path.join(base, "out")
        os.mkdir(out)
        for line in want.splitlines():
            name = e2e.run([e2e.DOMAIN, manifest[0], "", line.split()[0], out]).ok().out.split()[0]
            expect(os.path.exists(os.path.join(d.cache, "domains", name)), "the daemon has no %s" % name)
        status(e2e.run([e2e.DOMAIN, "--job-plan", manifest[0]]), 1, "no plan")
        status(e2e.run([e2e.DOMAIN, "--job-plan", file, manifest[0]]), 2, "a file and nothing else")
        status(e2e.run([e2e.DOMAIN, "--load", "0", "--plan", manifest[0], ""]), 2, "--load wants")
        status(e2e.run([e2e.DOMAIN, "--memory", "16M", "--load", "90000", "--plan", manifest[0], ""]), 1, "the memory carries")


def killed_daemon_resumes():
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        d = e2e.Daemon(base, memory="32M", env=gate.env).start()
        path = survey(base, points=600000)
        d.ctl("push", "big", path).ok()
        gate.close("renameat", "/domains/", 5)
        job = d.ctl("submit", "big").ok().out.split()[0]
        gate.wait()
        d.stop(signal.SIGKILL)
        gate.open()
        d.start()
        got = d.ctl("wait", job, "--json").ok()
        out = os.path.join(base, "m.ply")
        d.ctl("fetch", job, "-o", out).ok()
        e2e.run([e2e.VERIFY, out, path]).ok()
        expect(got.status == 0, got.err)
        d.stop(signal.SIGKILL)


def sigterm_leaves_clean_folders():
    """A daemon that is stopped during a job stores the domain that it works on, and no others."""
    with e2e.Folder() as base:
        gate = e2e.Gate(base)
        d = e2e.Daemon(base, memory="32M", threads=1, env=gate.env).start()
        path = survey(base, points=600000)
        d.ctl("push", "big", path).ok()
        gate.close("renameat", "/domains/", 2)
        d.ctl("submit", "big").ok()
        gate.wait()
        d.process.send_signal(signal.SIGTERM)
        # It has heard of it when nobody is let in any more.
        e2e.until(lambda: d.ctl("ping").status != 0, "SIGTERM: it still serves")
        gate.open()
        code = d.stop()
        expect(code == 0, "SIGTERM: status %s" % code)
        stored = [n for _, _, fs in os.walk(d.cache + "/domains") for n in fs]
        expect(len(stored) <= 4, "%d domains are stored: it has gone on" % len(stored))
        left = [n for top in (d.state, d.cache) for _, _, fs in os.walk(top) for n in fs if n.endswith(".tmp")]
        expect(not left, str(left))
        d.start()
        third = e2e.run(d.command, timeout=e2e.PATIENCE)
        d.stop(signal.SIGKILL)
        expect(third.status != 0 and "another acutd (pid " in third.err,
               "a second daemon on the same folders: %d %s" % (third.status, third.err))


def refusals():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, out = survey(base, points=1000), os.path.join(base, "m.ply")
        bad = os.path.join(base, "bad.las")
        with open(path, "rb") as f, open(bad, "wb") as g:
            g.write(f.read()[:-10])
        text = os.path.join(base, "t.xyz")
        with open(text, "w") as f:
            f.write("0 0 0\n1 0 0\nx 1 0\n")
        status(d.ctl("mesh", "-o", out, bad), 1, "bad.las")
        status(d.ctl("mesh", "-o", out, text), 1, "t.xyz", "3")
        expect(not os.path.exists(out), "an output of a failed run")
        status(d.ctl("mesh", "-o", out, path, bad), 3, "bad.las")
        os.unlink(out)
        status(d.ctl("mesh", "--strict", "-o", out, path, bad), 1, "bad.las")
        expect(not os.path.exists(out), "--strict kept an output")
        status(d.ctl("mesh", "--accept-truncated", "-o", out, bad), 0)
        status(d.ctl("mesh", "-o", out, path, "--geoid", "egm96"), 4, "no geoid grid", "acutctl geoid add")
        status(d.ctl("mesh", "-o", out, path, "--rubbish"), 2)
        status(d.ctl("mesh", "-o", path, path), 2)
        status(d.ctl("mesh", "-o", out), 2)
        status(d.ctl("nonsense"), 2)
        status(d.ctl("show", "424242"), 4)
        status(d.ctl("submit", "nobody"), 4)
        # An empty name, as from an unset variable, is an error and not another dataset.
        status(d.ctl("push", "", path), 2, 'cannot name a dataset')
        status(d.ctl("dataset", "show", ""), 4, 'no dataset ""')
        status(d.ctl("dataset", "export", "", os.path.join(base, "export")), 4, 'no dataset ""')
        status(d.ctl("mesh", "--ground", "-o", out, text.replace("t.xyz", "g.xyz")), 1)
        status(e2e.run([e2e.ACUTCTL, "jobs"], env={"ACUT_SOCKET": os.path.join(base, "none.sock")}), 69)
        with open(text, "w") as f:
            f.write("0 0 0\n1 1 0\n2 2 0\n")
        got = d.ctl("mesh", "--json", "-o", out, text).ok().json()
        expect(got["triangles"] == 0, str(got))
        got = json.loads(d.ctl("mesh", "--json", "-o", out, bad).err.splitlines()[-1] if False else
                         d.ctl("mesh", "--json", "-o", out, bad).out.splitlines()[-1])
        expect(set(got["error"]) >= {"code", "file", "offset", "field", "message", "hint"}, str(got))


def streams_and_signals():
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        path, out = survey(base, points=600000), os.path.join(base, "m.ply")
        # Standard output, and a reader that goes away.
        p = subprocess.run([e2e.ACUTCTL, "mesh", "-o", "-", "--format", "ply", "--quiet", path], stdout=subprocess.PIPE,
                           stderr=subprocess.PIPE, env=dict(os.environ, ACUT_SOCKET=d.socket))
        expect(p.returncode == 0 and p.stdout[:4] == b"ply\n", "%d %s" % (p.returncode, p.stderr))
        with open(out, "wb") as f:
            f.write(p.stdout)
        e2e.run([e2e.VERIFY, out, path]).ok()
        os.unlink(out)
        # In the middle of writing: to a file that has no name yet.
        gate = e2e.Gate(base)
        gate.close("pwrite", base, 2)
        p = subprocess.Popen([e2e.ACUTCTL, "mesh", "-o", out, path], stderr=subprocess.PIPE, stdout=subprocess.PIPE,
                             env=dict(os.environ, ACUT_SOCKET=d.socket, **gate.env))
        expect(gate.wait(lambda: p.poll() is not None), "it was over before it was interrupted")
        p.send_signal(signal.SIGINT)
        gate.open()
        p.communicate(timeout=e2e.PATIENCE)
        expect(p.returncode == 130, "SIGINT: %d" % p.returncode)
        expect([n for n in os.listdir(base) if n.startswith("m.ply") or n.startswith(".m.ply")] == [], str(os.listdir(base)))
        gate.close("pwrite", base, 2)
        p = subprocess.Popen([e2e.ACUTCTL, "mesh", "-o", out, path], stderr=subprocess.PIPE, stdout=subprocess.PIPE,
                             env=dict(os.environ, ACUT_SOCKET=d.socket, **gate.env))
        expect(gate.wait(lambda: p.poll() is not None), "it was over before it was killed")
        p.kill()
        p.communicate()
        d.ctl("mesh", "-o", out, path).ok()
        e2e.until(lambda: d.ctl("status", "--json").ok().json()["jobs_running"] == 0, "a job of a dead client runs on")


def private_daemon():
    with e2e.Folder() as base:
        path, out = survey(base, points=50000), os.path.join(base, "m.ply")
        env = {"XDG_RUNTIME_DIR": base, "XDG_CACHE_HOME": base + "/c", "XDG_STATE_HOME": base + "/s", "HOME": base}
        env["ACUT_SOCKET"] = ""
        got = e2e.run([e2e.ACUTCTL, "mesh", "--json", "-o", out, path], env=env).ok().json()
        own = e2e.run([e2e.ACUTCTL, "mesh", "--json", "--memory", "24M", "--threads", "1", "-o", out, path], env=env).ok().json()
        expect(got["digest"] == own["digest"], "digests differ")
        expect(e2e.sanitized() or own["peak_rss_bytes"] <= (24 + 32) << 20, "VmHWM %d" % own["peak_rss_bytes"])
        left = [n for n in os.listdir(base + "/c/acut") if n.startswith("own-")]
        expect(not left, "left: %s" % left)
        # With --private it is the shared one, as it is told: an idle one is replaced, one at work says what it has.
        for words, memory in (((), None), (("--memory", "300M"), 300 << 20), ((), 300 << 20), (("--memory", "200M", "--threads", "1"), 200 << 20)):
            e2e.run([e2e.ACUTCTL, "mesh", "-q", "--private", "-o", out, path, *words], env=env).ok()
            has = e2e.run([e2e.ACUTCTL, "status", "--private", "--json"], env=env).ok().json()
            expect(memory in (None, has["memory"]), "%s: %s" % (words, has["memory"]))
        with subprocess.Popen([e2e.ACUTCTL, "push", "d", "-", "--input-format", "xyz", "--private"], env=dict(os.environ, **env),
                              stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as busy:
            e2e.until(lambda: e2e.run([e2e.ACUTCTL, "status", "--private", "--json"], env=env).json()["connections"] > 1, "a push that holds the private daemon")
            for words, what in ((("--memory", "300M"), "has 200 MB of memory, not 300M"), (("--threads", "2"), "has 1 thread, not 2")):
                got = e2e.run([e2e.ACUTCTL, "mesh", "-q", "--private", "-o", out, path, *words], env=env)
                expect(got.status == 75 and what in got.err and str(has["pid"]) in got.err, got.err)
            e2e.run([e2e.ACUTCTL, "mesh", "-q", "--private", "-o", out, path, "--memory", "200M"], env=env).ok()
            busy.stdin.close()
        e2e.end_daemons(base)


def private_daemon_of_another_build():
    """A private daemon of another build is used while it works, but not with another memory or number of threads."""
    with e2e.Folder() as base:
        path, out, other = survey(base, points=1000), os.path.join(base, "m.ply"), os.path.join(base, "acutd")
        version = e2e.run([e2e.ACUTD, "--version"]).ok().out.split()[1].encode() + b"\0"
        with open(e2e.ACUTD, "rb") as f, open(other, "wb") as to:
            program = f.read()
            expect(b"\0" + version in program, "acutd has no version")
            to.write(program.replace(b"\0" + version, b"\0" + b"x" * (len(version) - 1) + b"\0"))
        os.chmod(other, 0o755)
        env = {"XDG_RUNTIME_DIR": base, "XDG_CACHE_HOME": base + "/c", "XDG_STATE_HOME": base + "/s", "HOME": base, "ACUT_SOCKET": ""}
        with subprocess.Popen([e2e.ACUTCTL, "push", "d", "-", "--input-format", "xyz", "--private"],
                              env=dict(os.environ, ACUT_ACUTD=other, **env), stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as busy:
            has = lambda: e2e.run([e2e.ACUTCTL, "status", "--socket", base + "/acut/acutd.sock", "--json"], env=env)
            e2e.until(lambda: has().status == 0 and has().json()["connections"] > 1, "a push that holds the private daemon")
            expect("x" in has().json()["version"], str(has().json()))
            for words, text in (((), ""), (("--memory", "300M"), "of memory, not 300M"), (("--threads", "7"), "not 7")):
                status(e2e.run([e2e.ACUTCTL, "mesh", "-q", "--private", "-o", out, path, *words], env=env), 75 if text else 0, text)
            busy.stdin.close()
        e2e.end_daemons(base)


def standard_output_by_path():
    """Standard output that appends to a file keeps what the file had."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, log = survey(base, points=1000), os.path.join(base, "log")
        meshes = []
        for name in ("-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"):
            with open(log, "wb") as f:
                f.write(b"before\n")
            with open(log, "ab") as f:
                subprocess.run([e2e.ACUTCTL, "mesh", "--socket", d.socket, "-o", name, "--format", "obj", "--canonical", "-q", path],
                               stdout=f, check=True)
            with open(log, "rb") as f:
                meshes.append(f.read())
            expect(meshes[-1].startswith(b"before\n") and meshes[-1].count(b"\nv ") == meshes[0].count(b"\nv ") > 0,
                   "%s: %s" % (name, meshes[-1][:80]))


def named():
    """--name changes the name of a file; its identity is its path."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        one, other = survey(base, "a.las", 1000), survey(base, "b.las", 1000, "--seed", "5")
        d.ctl("push", "v", one, "--name", "flight 7").ok()
        files = d.ctl("dataset", "log", "v", "--files", "--json").ok().json()["files"]
        expect([(f["name"], f["path"]) for f in files] == [("flight 7", one)], str(files))
        again = d.ctl("push", "v", one, "--name", "flight 8", "--json").ok().json()
        expect(again["state"] == "known", str(again))
        status(d.ctl("push", "v", one, other, "--name", "both"), 2, "one input, and there are 2", one, other)
        status(d.ctl("push", "v", other, "--name", "a/b"), 2, "without slashes")


e2e.main(mesh_is_complete, verify_catches, datasets_and_jobs, domains_from_files_alone, regions_from_files_alone, killed_daemon_resumes,
         sigterm_leaves_clean_folders, refusals,
         streams_and_signals, private_daemon, private_daemon_of_another_build, standard_output_by_path, named)
