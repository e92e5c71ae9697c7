"""`cache verify` finds what was damaged, and names it."""
import glob
import json
import os
import signal

import e2e
from e2e import expect
from space import Half, digests, files_below, stat, synth, until
from acut_wire import Client, pb  # after space.py, which skips if it is not there


def flip(path, at):
    with open(path, "r+b") as f:
        f.seek(at)
        byte = f.read(1)
        f.seek(at)
        f.write(bytes([byte[0] ^ 0x40]))


def verify_names_damage():
    with e2e.Folder() as base:
        d = e2e.Daemon(base, memory="24M").start()
        try:
            d.ctl("push", "a", synth(os.path.join(base, "a.las"), 100000)).ok()
            d.ctl("push", "b", synth(os.path.join(base, "b.las"), 30000, 2)).ok()
            want = digests(d, "a")
            digests(d, "a", "--every", "2")
            # An interrupted push, durable.
            Half(d, "c", synth(os.path.join(base, "c.las"), 20000, 3), durable=True).c.close()
            runs = os.path.join(d.state, "datasets", "*", "push-*.run*")
            expect(until(lambda: stat(d)["kinds"]["pending"]["entries"] == 1), stat(d))
            r = d.ctl("cache", "verify", "--json").ok()
            whole = json.loads(r.out.splitlines()[-1])
            expect(whole["damaged"] == 0 and whole["derived_damaged"] == 0 and whole["files"] >= 8 and
                   whole["bytes"] > 150000 * 16, whole)

            def verify(damaged, derived, *words):
                r = d.ctl("cache", "verify", "--json")
                lines = [json.loads(line) for line in r.out.splitlines()]
                last = lines.pop()
                expect((last["damaged"], last["derived_damaged"]) == (damaged, derived), r.out)
                expect(r.status == (1 if damaged else 0), r.status)
                expect(len(lines) == damaged + derived, r.out)
                for line in lines:
                    expect(line["error"]["code"] == "corrupt" and line["error"]["file"], line)
                for word in words:
                    expect(any(word == line["damaged"] or word == line["dataset"] for line in lines), "%s: %s" % (word, r.out))
                return lines

            # Derived: a domain, the plan, the selection. Each is told once and removed.
            domains = [f for f in files_below(os.path.join(d.cache, "domains")) if os.path.getsize(f) > 10000]
            flip(domains[0], os.path.getsize(domains[0]) // 2)
            plans = sorted(glob.glob(os.path.join(d.state, "plans", "plan-*")))
            flip(plans[0], 150)
            selection = glob.glob(os.path.join(d.cache, "selected", "*", "*.seg"))[0]
            flip(selection, os.path.getsize(selection) // 2)
            lines = verify(0, 3, "domain", "plan", "selection")
            expect(all(line["removed"] and line["derived"] for line in lines), lines)
            expect(not os.path.exists(domains[0]) and not os.path.exists(selection), "what is damaged is still there")
            verify(0, 0)
            expect(digests(d, "a") == want, "another mesh")
            # Pushed: a block, the index, a run, each told until it is mended.
            segment = max(glob.glob(os.path.join(d.state, "datasets", "*", "*.seg")), key=os.path.getsize)
            size = os.path.getsize(segment)
            flip(segment, size // 3)
            line = verify(1, 0, "segment", "a")[0]
            expect(os.path.basename(segment) in line["error"]["file"] and
                   abs(line["error"]["offset"] - size // 3) < 40000, line)
            flip(segment, size // 3)
            flip(segment, size - 2000)
            verify(1, 0, "segment")
            flip(segment, size - 2000)
            verify(0, 0)
            run = glob.glob(runs)[0]
            flip(run, 9000)
            verify(1, 0, "push", "c")
            flip(run, 9000)
            manifest = glob.glob(os.path.join(os.path.dirname(segment), "manifest-*"))[0]
            flip(manifest, 100)
            verify(1, 0, "manifest", "a")
            flip(manifest, 100)
            verify(0, 0)
            text = d.ctl("cache", "verify").ok().out
            expect("0 damaged" in text, text)
            # A file that is gone is damage too.
            os.rename(segment, segment + ".away")
            r = d.ctl("cache", "verify", "--json")
            expect(r.status == 1 and os.path.basename(segment) in r.out, r.out)
            # A job that needs it fails at once with that error, and not one about the cache. The log and the end of a stream have it, too.
            jobs = d.ctl("submit", "a", "--wait"), d.ctl("submit", "a", "--new", "--wait")
            fetched = d.ctl("fetch", jobs[0].ok().out.split()[0], "--format", "null", "--json")
            expect(fetched.json()["error"]["code"] == "corrupt", fetched.out)
            for r in jobs[1], fetched:
                expect(r.status == 74 and os.path.basename(segment) in r.out + r.err and "is gone" in r.out + r.err, r.out + r.err)
            expect("begins again" not in d.log_text() and "what is stored is damaged: " + os.path.basename(segment) in d.log_text(),
                   d.log_text())
            os.rename(segment + ".away", segment)
            expect(digests(d, "a") == want, "another mesh")
        finally:
            d.stop(signal.SIGKILL)


def a_client_of_verify_goes():
    """A client that does not read the reports of damage is disconnected; the daemon keeps running, and the next verification
    succeeds."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="24M") as d:
        junk = os.path.join(d.cache, "domains")
        names = [os.path.join(junk, "%0120d" % i) for i in range(2500)]
        for name in names:
            with open(name, "wb") as f:
                f.write(b"junk")
        c = Client(d.socket)
        c.send("cache_verify", pb.CacheVerify())
        expect(until(lambda: "does not read its answers" in d.log_text()), "nobody was cut off: %s" % d.log_text()[-300:])
        r = d.ctl("ping")
        expect(r.status == 0, "the daemon does not answer any more: %d %s" % (r.status, r.err))
        c.close()
        for name in filter(os.path.exists, names):
            os.remove(name)
        r = until(lambda: [r for r in [d.ctl("cache", "verify", "--json")] if r.status == 0])
        expect(r and json.loads(r[0].out.splitlines()[-1])["damaged"] == 0, "no verify any more")


if __name__ == "__main__":
    e2e.main(verify_names_damage, a_client_of_verify_goes)
