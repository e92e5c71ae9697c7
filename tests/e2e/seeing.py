"""Monitoring: metrics that Prometheus' parser reads and that change with events, and journal entries with fields for each
event."""
import ctypes
import json
import os
import re
import select
import shutil
import socket
import stat
import struct
import subprocess
import threading
import time

import e2e
from e2e import expect

try:
    from prometheus_client.parser import text_string_to_metric_families as parse
except ImportError:
    parse = None


def survey(base, name="survey.las", points=20000, *options):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", points, *options, path]).ok()
    return path


# ---- metrics ----

def rows(text):
    """{(name, labels): value}, by a parser of its own, so that all rules of the text format are checked without the package,
    too."""
    got, helps, types, closed, now = {}, {}, {}, set(), None
    for line in text.splitlines():
        m = re.fullmatch(r"# (HELP|TYPE) ([a-zA-Z_:][a-zA-Z0-9_:]*) (.*)", line)
        if m:
            table = helps if m[1] == "HELP" else types
            expect(m[2] not in table, "%s twice: %s" % (m[1], line))
            table[m[2]] = m[3]
            if m[1] == "HELP":
                expect(m[2] not in closed, "%s begins twice" % m[2])
                closed.add(m[2])
            now = m[2]
            continue
        m = re.fullmatch(r'([a-zA-Z_][a-zA-Z0-9_]*)(\{((?:[a-z_]+="(?:[^"\\\n]|\\["\\n])*",?)*)\})? (\S+)', line)
        expect(m, "not a sample: %r" % line)
        expect(m[1] == now, "%s stands with %s" % (m[1], now))
        labels = tuple(sorted(re.findall(r'([a-z_]+)="((?:[^"\\]|\\.)*)"', m[3] or "")))
        expect((m[1], labels) not in got, "twice: %s" % line)
        got[m[1], labels] = float(m[4])
    expect(set(helps) == set(types) == {n for n, _ in got}, "HELP, TYPE and samples: %s" % (set(helps) ^ {n for n, _ in got}))
    # The rules of promtool's linter.
    for n, t in types.items():
        expect(t in ("counter", "gauge"), "%s is a %s" % (n, t))
        expect(n.endswith("_total") == (t == "counter"), "%s and its type, %s" % (n, t))
        expect(n.startswith("acut_") and helps[n].strip(), "%s: name and help" % n)
        expect(not re.search(r"(?i)_(gauge|counter|histogram|milliseconds|ms|minutes|hours|days|kb|mb|kib|mib|gib|percent)(_|$)", n), "unit of " + n)
        expect(not n.endswith(("_count", "_sum", "_bucket")), "%s is of a histogram" % n)
    # In OpenMetrics a counter's family has no _total: it must not be another one.
    names = [n[:-6] if n.endswith("_total") else n for n in types]
    expect(len(names) == len(set(names)), "names that differ by _total only: %s" % sorted(n for n in names if names.count(n) > 1))
    return got


def metrics(d, **kw):
    text = d.ctl("metrics", **kw).ok().out
    got = rows(text)
    if parse:
        theirs = {(s.name, tuple(sorted(s.labels.items()))): s.value for f in parse(text) for s in f.samples}
        expect(theirs == got, "prometheus_client reads: %s" % sorted(set(theirs.items()) ^ set(got.items()))[:5])
    return got


def value(got, family, **labels):
    hits = [v for (n, l), v in got.items() if n == family and set(labels.items()) <= set(l)]
    expect(len(hits) == 1, "%d samples of %s %s" % (len(hits), family, labels))
    return hits[0]


def total(d, family, **labels):
    return value(metrics(d), family, **labels)


def metrics_tell_what_is_there():
    if not parse:
        e2e.unavailable("python3-prometheus-client is not installed")
    begun = time.time()
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = survey(base)
        got = metrics(d)
        expect(value(got, "acut_up") == 1 and value(got, "acut_last_verify_timestamp_seconds") == 0, "")
        before = time.time()
        d.ctl("push", "vol", path).ok()
        d.ctl("submit", "vol", "--wait").ok()
        d.ctl("dataset", "create", "empty").ok()
        got = metrics(d)
        expect(value(got, "acut_dataset_points", dataset="vol", uid=str(os.getuid())) == 20000, "points")
        expect(value(got, "acut_dataset_bytes", dataset="vol") == value(got, "acut_stored_bytes", kind="datasets") > 100000, "bytes")
        expect(value(got, "acut_user_bytes", uid=str(os.getuid())) == value(got, "acut_dataset_bytes", dataset="vol"), "of the user")
        expect(before - 1 < value(got, "acut_dataset_last_push_timestamp_seconds", dataset="vol") < time.time() + 1, "last push")
        expect(value(got, "acut_dataset_last_push_timestamp_seconds", dataset="empty") == 0, "no push yet")
        expect(value(got, "acut_datasets") == 2, "datasets")
        status = json.loads(d.ctl("status", "--json").ok().out)
        expect(value(got, "acut_memory_limit_bytes") == 256 << 20 == status["memory"], "memory")
        expect(value(got, "acut_ledger_bytes", name="thread") > 0 and value(got, "acut_ledger_peak_bytes", name="stage") > 0, "ledger")
        expect(value(got, "acut_triangles_made_total") > 30000 and value(got, "acut_points_staged_total") == 20000, "work")
        expect(value(got, "acut_input_bytes_total") >= 20000 * 20, "bytes read")
        expect(0 < value(got, "acut_filesystem_free_bytes", side="state") < value(got, "acut_filesystem_size_bytes", side="state"), "")
        expect(begun - 1 < value(got, "acut_start_time_seconds") < before + 1, "start")
        one = d.ctl("metrics", "--json").ok().out.splitlines()
        expect({"name": "acut_up", "type": "gauge", "labels": {}, "value": 1} == json.loads(one[0]), one[0])


def manual_has_every_metric():
    """acut-metrics(7) and the daemon have the same names."""
    man = os.path.join(os.environ.get("ACUT_MAN") or os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../man"), "acut-metrics.7.scd")
    with open(man) as f:
        told = set(re.findall(r"\*(acut_[a-z_]+)\*", f.read()))
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "vol", survey(base, points=2000)).ok()
        d.ctl("cache", "verify").ok()
        got = {n for n, _ in metrics(d)}
    expect(not got - told, "not in man/acut-metrics.7.scd: %s" % sorted(got - told))
    expect(not told - got, "in man/acut-metrics.7.scd, and acutd has none: %s" % sorted(told - got))


def flip(path, at):
    with open(path, "r+b") as f:
        f.seek(at, 2 if at < 0 else 0)
        b = f.read(1)
        f.seek(-1, 1)
        f.write(bytes([b[0] ^ 0x55]))


def files_below(folder, want):
    return sorted(os.path.join(p, n) for p, _, names in os.walk(folder) for n in names if want(n))


MOVING = ("acut_jobs_ended_total", "acut_pushes_total", "acut_files_refused_total", "acut_files_staged_total", "acut_checksum_errors_total",
          "acut_domains_made_total", "acut_domains_reused_total", "acut_points_staged_total", "acut_refusals_total")


def moved(d, what, **want):
    """Runs `what`. Only the counters named in `want` may change, by these numbers. Labels follow two underscores."""
    def counts():
        return {k: v for k, v in metrics(d).items() if k[0] in MOVING}
    before = counts()
    log = len(d.log_text())
    what()
    after = counts()
    got = {}
    for (name, labels), v in after.items():
        if v != before[name, labels]:
            got["__".join([name[5:]] + [x for _, x in labels])] = v - before[name, labels]
    expect(got == want, "moved: %s, not %s\n%s" % (got, want, d.log_text()[log:]))
    return d.log_text()[log:]


def told(log, *want):
    """Each text is in exactly one line of the log, and there is no other warning or error."""
    lines = log.splitlines()
    for w in want:
        expect(len([l for l in lines if w in l]) == 1, "%r is not said once:\n%s" % (w, log))
    rest = [l for l in lines if (": warning: " in l or ": error: " in l) and not any(w in l for w in want)]
    expect(not rest, "said beside that: %s" % rest)


def counters_move():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        good, other, broken = survey(base), survey(base, "o.las", 10000, "--seed", 7), os.path.join(base, "broken\x1b[31m.las")
        shutil.copy(good, broken)
        os.truncate(broken, 3000)
        told(moved(d, lambda: d.ctl("push", "vol", good).ok(), pushes_total__committed=1, files_staged_total=1,
                   points_staged_total=20000), "push 1 of user %d into vol is done" % os.getuid())
        log = moved(d, lambda: expect(d.ctl("push", "vol", broken).status == 1, "taken"), files_refused_total=1)
        told(log, "a file is refused")
        expect("\x1b" not in log, "a name moves the terminal")
        told(moved(d, lambda: d.ctl("submit", "vol", "--wait").ok(), jobs_ended_total__done=1, domains_made_total=1), "job 1 of vol is done")
        told(moved(d, lambda: d.ctl("submit", "vol", "--wait", "--new").ok(), jobs_ended_total__done=1, domains_reused_total=1), "job 2 of vol")
        # No point is left by the view of a job that asks for the ground.
        told(moved(d, lambda: expect(d.ctl("submit", "vol", "--wait", "--ground", "--zmin", "100000").status == 1, "done"),
                   jobs_ended_total__failed=1), "job 3 of vol failed")
        # A domain of the cache is damaged: it is made again.
        domains = files_below(d.cache, lambda n: n.endswith(".dom")) or files_below(os.path.join(d.cache, "domains"), lambda n: True)
        for p in domains:
            flip(p, -2000)
        log = moved(d, lambda: d.ctl("fetch", "2", "-o", os.path.join(base, "m.ply")).ok(), domains_made_total=1,
                    checksum_errors_total__derived=1)
        told(log, "a stored domain of vol was damaged: it is made again")
        # Pushed data is damaged: the job fails, and the damage is reported.
        for p in files_below(d.state, lambda n: n.endswith(".seg")):
            flip(p, 40000)
        log = moved(d, lambda: expect(d.ctl("submit", "vol", "--wait", "--every", "2").status == 74, "done"), jobs_ended_total__failed=1,
                    checksum_errors_total__pushed=1)
        told(log, "job 4 of vol failed", "what is stored is damaged")
        expect(total(d, "acut_events_total", event="job_failed") == 2, "events")
        told(moved(d, lambda: d.ctl("push", "two", other).ok(), pushes_total__committed=1, files_staged_total=1, points_staged_total=10000),
             "into two is done")
        d.ctl("dataset", "rm", "two").ok()
        expect("the dataset two was removed" in d.log_text(), "not told")
        got = metrics(d)
        expect(value(got, "acut_datasets_removed") == 1 and value(got, "acut_stored_bytes", kind="removed") > 0, "removed")
        expect(not [k for k in got if ("dataset", "two") in k[1]], "it is gone")


def many_datasets_come_in_pages():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        names = ["n%03d" % i + "x" * 40 for i in range(130)]
        ps = [subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "dataset", "create", n]) for n in names]
        expect(not any(p.wait() for p in ps), "not made")
        got = metrics(d)
        expect(sorted(dict(l)["dataset"] for n, l in got if n == "acut_dataset_points") == names, "datasets")
        expect(value(got, "acut_datasets") == 130, "number")


def textfile_is_whole_or_not_there():
    with e2e.Folder() as base:
        out, umask = os.path.join(base, "acut.prom"), os.umask(0o077)
        try:
            with e2e.Daemon(base) as d:
                d.ctl("metrics", "--textfile", out).ok()
                expect(stat.S_IMODE(os.stat(out).st_mode) == 0o644, "mode %o" % os.stat(out).st_mode)
                expect(value(rows(open(out).read()), "acut_up") == 1, "up")
                expect(os.listdir(base).count("acut.prom") == 1 and not [n for n in os.listdir(base) if ".tmp" in n], os.listdir(base))
                run = d.ctl("metrics", "--textfile", "/nonexistent/x.prom")
                expect(run.status == 74 and "/nonexistent/x.prom" in run.err, run.err)
                expect(d.ctl("metrics", "--json", "--textfile", out).status == 2, "both")
                d.stop()
                run = d.ctl("metrics", "--textfile", out)
                expect(run.status == 69, "status %d" % run.status)
                expect(rows(open(out).read()) == {("acut_up", ()): 0.0}, "down")
                expect(d.ctl("metrics").status == 69, "without a file")
        finally:
            os.umask(umask)


OTHER = 65534


def as_other(d, *args):
    """acutctl as another user."""
    def become():
        os.setgroups([])
        os.setgid(OTHER)
        os.setuid(OTHER)
    env = dict(os.environ, ACUT_SOCKET=d.socket)
    p = subprocess.run([e2e.ACUTCTL, *args], preexec_fn=become, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                       stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
    return e2e.Run([e2e.ACUTCTL, *args], p.returncode, p.stdout.decode(), p.stderr.decode())


def others_see_what_they_may():
    if os.getuid():
        print("skipped: not root")
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        os.chmod(base, 0o755)
        os.chmod(d.socket, 0o666)
        mine = survey(base, "c.las", 5000)
        os.chmod(mine, 0o644)
        d.ctl("push", "closed", survey(base)).ok()
        d.ctl("dataset", "chmod", "600", "closed").ok()
        as_other(d, "push", "mine", mine).ok()
        got = rows(as_other(d, "metrics").ok().out)
        seen = {dict(l)["dataset"] for n, l in got if n == "acut_dataset_points"}
        expect(seen == {"mine"}, "another user sees %s" % seen)
        expect({dict(l)["uid"] for n, l in got if n.startswith("acut_user_")} == {str(OTHER)}, "and what others have")
        got = metrics(d)
        expect({dict(l)["dataset"] for n, l in got if n == "acut_dataset_points"} == {"mine", "closed"}, "root sees all")
        expect({dict(l)["uid"] for n, l in got if n == "acut_user_bytes"} == {"0", str(OTHER)}, "root sees all")


# ---- doctor ----


# ---- the journal ----

def apart(what, child):
    """child() in a process and a mount namespace of its own."""
    pid = os.fork()
    if pid:
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        if status == 77:
            e2e.unavailable("no mount namespace for " + what)
        expect(status == 0, "see above")
        return
    try:
        if not in_own_run():
            os._exit(77)
        child()
        os._exit(0)
    except SystemExit as e:
        os._exit(e.code)
    except BaseException as e:
        print("%s: %s" % (type(e).__name__, e), flush=True)
        os._exit(1)


def mount(path, options):
    libc = ctypes.CDLL(None, use_errno=True)
    expect(libc.mount(b"tmpfs", path.encode(), b"tmpfs", 0, options.encode()) == 0, "tmpfs at %s: %d" % (path, ctypes.get_errno()))


def entries(packet):
    """One entry in the journal's native protocol."""
    got, at = {}, 0
    while at < len(packet):
        end = packet.index(b"\n", at)
        line = packet[at:end]
        if b"=" in line:
            k, v = line.split(b"=", 1)
            at = end + 1
        else:
            n = struct.unpack_from("<Q", packet, end + 1)[0]
            k, v = line, packet[end + 9:end + 9 + n]
            at = end + 10 + n
        got.setdefault(k.decode(), []).append(v.decode())
    return {k: v[0] if len(v) == 1 else v for k, v in got.items()}


def in_own_run():
    """A /run/systemd of this process's own, in a mount namespace. False: that is not permitted."""
    libc = ctypes.CDLL(None, use_errno=True)
    if os.getuid() or libc.unshare(0x20000):
        return False
    if libc.mount(b"none", b"/", None, 0x44000, None) or libc.mount(b"tmpfs", b"/run", b"tmpfs", 0, None):
        return False
    os.makedirs("/run/systemd/journal")
    return True


def journal_entries_have_fields():
    apart("a journal of one's own", journal_child)


def journal_child():
    catalog = os.environ.get("ACUT_CATALOG") or os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../etc/acut.catalog")
    ids = dict(re.findall(r"-- ([0-9a-f]{32})\nSubject: (.*)\n", open(catalog).read()))
    journal = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    journal.bind("/run/systemd/journal/socket")
    got, ends = [], threading.Event()

    def listen():
        # All that was sent by then lies in the socket.
        while select.select([journal], [], [], 0.05)[0] or not ends.is_set():
            if select.select([journal], [], [], 0.05)[0]:
                got.append(entries(journal.recv(1 << 18)))
    thread = threading.Thread(target=listen)
    thread.start()
    try:
        with e2e.Folder() as base:
            d = e2e.Daemon(base)
            open(d.log, "w").close()
            st = os.stat(d.log)
            d.env["JOURNAL_STREAM"] = "%d:%d" % (st.st_dev, st.st_ino)
            with d:
                good, broken = survey(base), os.path.join(base, "bro\nken.las")
                shutil.copy(good, broken)
                os.truncate(broken, 3000)
                d.ctl("push", "vol", good).ok()
                d.ctl("push", "vol", broken)
                d.ctl("submit", "vol", "--wait").ok()
                d.ctl("submit", "vol", "--wait", "--ground", "--zmin", "100000")
                time.sleep(0.3)
                expect(d.log_text() == "", "also on stderr: " + d.log_text())
                # journald goes: the lines come to stderr, with their levels.
                os.rename("/run/systemd/journal/socket", "/run/systemd/journal/gone")
                d.ctl("submit", "vol", "--wait", "--ground", "--zmin", "99999")
                expect(re.search(r"^<4>job 3 of vol failed: ", d.log_text(), re.M), "not on stderr: " + d.log_text())
    finally:
        ends.set()
        thread.join()
    by = {e["ACUT_EVENT"]: e for e in got if "ACUT_EVENT" in e}
    for e in got:
        expect(e["SYSLOG_IDENTIFIER"] == "acutd" and e["PRIORITY"] in "34567" and e["CODE_FILE"].endswith((".c", ".h")), str(e))
        expect("ACUT_EVENT" not in e or e["MESSAGE_ID"] in ids, "not in the catalogue: %s" % e)
        expect(int(e["CODE_LINE"]) > 0 and e["CODE_FUNC"], str(e))
    uid = str(os.getuid())
    expect({"START", "READY", "PUSH_COMMITTED", "FILE_REFUSED", "JOB_DONE", "JOB_FAILED"} <= set(by), "events: %s" % sorted(by))
    done, failed, refused, push = by["JOB_DONE"], by["JOB_FAILED"], by["FILE_REFUSED"], by["PUSH_COMMITTED"]
    expect((done["ACUT_JOB"], done["ACUT_DATASET"], done["ACUT_USER"], done["ACUT_GENERATION"]) == ("1", "vol", uid, "1"), str(done))
    expect((failed["ACUT_JOB"], failed["PRIORITY"], failed["ACUT_CODE"]) == ("2", "4", "bad-input"), str(failed))
    expect(refused["ACUT_FILE"].endswith("bro?ken.las") and "\n" not in refused["MESSAGE"] and int(refused["ACUT_PID"]) > 1, str(refused))
    expect(push["MESSAGE_ID"] in ids and ids[push["MESSAGE_ID"]] == "a push is done" and push["ACUT_PUSH"] == "1", str(push))
    expect(len([e for e in got if e.get("ACUT_JOB") == "2" and e["PRIORITY"] in "34"]) == 1, "a failure is told once")


if __name__ == "__main__":
    e2e.main(metrics_tell_what_is_there, manual_has_every_metric, counters_move, many_datasets_come_in_pages, textfile_is_whole_or_not_there,
             others_see_what_they_may, journal_entries_have_fields)
