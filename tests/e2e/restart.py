"""A daemon that was killed: its start, how submitted jobs continue, and which leftovers it removes."""
import os
import re
import signal
import subprocess
import time

import e2e
from e2e import Daemon, Folder, expect


def synth(path, points, seed=1):
    subprocess.run([os.environ["ACUT_SYNTH"], "--points", str(points), "--seed", str(seed), path], check=True)
    return path


def show(d, job):
    return d.ctl("show", str(job), "--json").ok().json()


def jobs_go_on():
    """Killed at several points of a job: the digests are the same, and no stored domain is made again."""
    with Folder() as base:
        gate = e2e.Gate(base)
        d = Daemon(base, memory="24M", env=gate.env).start()
        d.ctl("push", "valley", synth(base + "/a.las", 400000)).ok()
        want = d.ctl("submit", "valley", "--wait", "--json").ok().json()
        expect(want["domains"] >= 8, "the test wants many domains: %d" % want["domains"])
        d.stop()
        for part in (0.2, 0.5, 0.8):
            # This job uses no domains of earlier jobs.
            subprocess.run(["rm", "-rf", d.cache], check=True)
            d.start()
            # So many domains get their names in the store, and no more.
            kept = int(part * want["domains"])
            gate.close("renameat", "/domains/", kept)
            job = int(d.ctl("submit", "valley", "--new").ok().out.split()[0])
            gate.wait()
            now = show(d, job)
            expect(now["state"] == "meshing" and now["progress"]["domains"] < want["domains"], "held at %.1f: %s" % (part, now))
            d.stop(signal.SIGKILL)
            # One of those that were let go may not have got there.
            stored = sum(len([n for n in names if re.fullmatch("d-[0-9a-f]{32}-[0-9a-f]{32}", n)]) for _, _, names in os.walk(d.cache + "/domains"))
            expect(kept - 1 <= stored <= kept, "%d domains are stored, %d were let go" % (stored, kept))
            gate.open()
            d.start()
            d.ctl("wait", str(job)).ok()
            got = show(d, job)
            for key in ("digest", "vertex_digest", "triangles", "vertices", "points", "domains"):
                expect(got[key] == want[key], "killed at %.1f: %s %s, was %s" % (part, key, got[key], want[key]))
            reused = got["domains_reused"] or 0
            expect(reused == stored, "killed at %.1f with %d domains stored, and %d are used again" % (part, stored, reused))
            d.stop()


def leftovers_go():
    """The leftovers of a killed one-step mesh and a killed push are removed soon after the next start."""
    with Folder() as base:
        d = Daemon(base).start()
        d.ctl("push", "valley", synth(base + "/a.las", 20000)).ok()
        d.stop(signal.SIGKILL)
        for name in ("one-step/5", "tmp/x"):
            os.makedirs(os.path.join(d.cache, name))
            with open(os.path.join(d.cache, name, "push-9.0.run"), "wb") as f:
                f.write(b"x" * 100000)
        os.makedirs(d.cache + "/gone-0/y")
        with d:
            e2e.until(lambda: not [n for n in os.listdir(d.cache) if n.startswith("gone-")], lambda: "what was left stays: %s" % os.listdir(d.cache))
            expect(not os.listdir(d.cache + "/tmp") and not os.listdir(d.cache + "/one-step"), "leftovers")
            d.ctl("submit", "valley", "--wait").ok()


def damage_stays_where_it_is():
    """A dataset whose manifest is damaged, with a push interrupted: the daemon starts and serves the others."""
    with Folder() as base:
        d = Daemon(base).start()
        for name in ("valley", "ridge"):
            d.ctl("push", name, synth(base + "/%s.las" % name, 3000)).ok()
        d.stop()
        import sqlite3
        db = sqlite3.connect(d.state + "/catalogue.db")
        row, manifest = db.execute("SELECT id, manifest FROM dataset WHERE name = 'valley'").fetchone()
        columns = [c[1] for c in db.execute("PRAGMA table_info(push)")]
        values = {"id": 77, "dataset": row, "uid": os.getuid(), "files": 1, "begun_us": int(time.time() * 1e6)}
        db.execute("INSERT INTO push VALUES (%s)" % ",".join("?" * len(columns)), [values.get(c) for c in columns])
        db.commit()
        db.close()
        with open("%s/datasets/%d/%s" % (d.state, row, manifest), "r+b") as f:
            f.seek(40)
            f.write(b"\xff\xff")
        with d:
            d.ctl("submit", "ridge", "--wait").ok()
            got = d.ctl("submit", "valley", "--wait")
            expect(got.status == 74 and manifest in got.out + got.err, "%d %s %s" % (got.status, got.out, got.err))


if __name__ == "__main__":
    e2e.main(jobs_go_on, leftovers_go, damage_stays_where_it_is)
