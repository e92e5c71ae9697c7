"""acut-scan record without a scanner: from files and pipes. Kills, full disks, signals, and what is told; list without USB."""
import hashlib
import json
import os
import resource
import signal
import socket
import struct
import subprocess
import threading

import scan
from scan import PROFILES, Folder, Spool, expect, finish, run, start, telegrams
from e2e import until
from rest import rests


def lines(got):
    return [json.loads(line) for line in got.out.splitlines()]


def from_a_file():
    with Folder() as d:
        dump = telegrams(2000) + b"\x02broken"
        with open(d("dump"), "wb") as f:
            f.write(dump)
        got = run("record", "--from", d("dump"), "--profile", "sick-tim", "--profiles", PROFILES, "-o", d("a.spool"), "--json").ok()
        begin, end = lines(got)[0], lines(got)[-1]
        expect(begin["event"] == "begin" and begin["port"] == "file" and begin["profile"] == "sick-tim" and begin["vendor"] is None, begin)
        expect(end["event"] == "end" and end["ended"] == "end" and end["error"] is None, end)
        expect(end["bytes"] == end["durable"] == len(dump) and end["telegrams"] == 2000 and end["bad_telegrams"] == 1, end)
        expect(end["sha256"] == hashlib.sha256(dump).hexdigest(), end)
        s = Spool(d("a.spool"))
        expect(s.data == dump and s.ended and not s.torn and s.port == "file" and s.events == ["stop end"], s.events)
        with open(os.path.join(PROFILES, "sick-tim.conf")) as f:
            expect(s.profile == f.read() and s.profile_name == "sick-tim", "the profile is not in the spool")
        # Never over it.
        before = open(d("a.spool"), "rb").read()
        got = run("record", "--from", d("dump"), "-o", d("a.spool"))
        expect(got.status == 2 and "never written over" in got.err and open(d("a.spool"), "rb").read() == before, got.err)
        # Nor a spool for a dump.
        got = run("record", "--from", d("a.spool"), "-o", d("b.spool"))
        expect(got.status == 2 and "a spool already" in got.err and not os.path.exists(d("b.spool")), got.err)
        # What came through a spool comes out of it.
        run("replay", d("a.spool"), "--to", "raw", "-o", d("raw"), "--profiles", PROFILES).ok()
        expect(open(d("raw"), "rb").read() == dump, "replay gives other bytes")


def names_in_a_folder():
    with Folder() as d:
        for _ in range(3):
            run("record", "--from", "-", "--profile", "generic-xyz", "--profiles", PROFILES, "--folder", d.path, given=b"1 2 3\n").ok()
        names = sorted(os.listdir(d.path))
        expect(len(names) == 3 and all(n.startswith("generic-xyz-file-") and n.endswith(".spool") for n in names), names)


def limits():
    with Folder() as d:
        run("record", "--from", "/dev/zero", "-o", d("a"), "--bytes", "3M").ok()
        s = Spool(d("a"))
        expect(len(s.data) == 3 << 20 and s.events == ["stop bytes"] and s.ended, "%d" % len(s.data))
        run("record", "--from", "/dev/zero", "-o", d("b"), "--for", "0.2").ok()
        s = Spool(d("b"))
        expect(s.events == ["stop time"] and s.ended, s.events)
        # The human summary.
        got = run("record", "--from", "-", "-o", d("c"), given=b"abc").ok()
        expect("3 bytes" in got.out and hashlib.sha256(b"abc").hexdigest() in got.out, got.out)
        expect(run("record", "--from", "-", "-o", d("q"), "--quiet", given=b"abc").ok().out == "", "quiet is not")


def signals_are_a_good_end():
    for sig in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        with Folder() as d:
            p = start("record", "--from", "-", "-o", d("a"), stdin=subprocess.PIPE)
            p.stdin.write(b"some")
            p.stdin.flush()
            until(lambda: os.path.exists(d("a")) and b"some" in open(d("a"), "rb").read(), "it is not there")
            p.send_signal(sig)
            p.wait(timeout=180) # its pipe is open
            finish(p).ok()
            s = Spool(d("a"))
            expect(s.data == b"some" and s.ended and s.events == ["stop signal"], s.events)


def a_pipe_that_nobody_writes_into():
    with Folder() as d:
        os.mkfifo(d("pipe"))
        run("record", "--from", d("pipe"), "-o", d("a"), "--for", "0.2").ok()
        expect(Spool(d("a")).events == ["stop time"], "other events")
        p = start("record", "--from", d("pipe"), "-o", d("b"), "--json")
        until(lambda: os.path.exists(d("b")), "no spool")
        with open(d("pipe"), "wb") as f:
            f.write(b"some")
        finish(p).ok()
        s = Spool(d("b"))
        expect(s.data == b"some" and s.events == ["stop end"], s.events)


def feed(pipe):
    """More and more, until nobody reads."""
    some = os.urandom(1 << 20)
    try:
        while True:
            os.write(pipe.fileno(), some)
    except BrokenPipeError:
        pass


def kill_and_go_on_reading():
    """kill -9 at any moment: all that was told to be there is; the records are whole."""
    for size in (1, 3, 10, 20, 40):
        with Folder() as d:
            p = start("record", "--from", "-", "-o", d("a"), "--sync", "0.05", "--json", stdin=subprocess.PIPE)
            feeder = threading.Thread(target=feed, args=(p.stdin,))
            feeder.start()
            until(lambda: os.path.exists(d("a")) and os.path.getsize(d("a")) > size << 20, "no %d MB" % size)
            p.kill()
            feeder.join()
            finish(p)
            s = Spool(d("a"))
            expect(not s.ended and len(s.data) > 500000 and s.torn < 300000, "%d bytes, %d torn" % (len(s.data), s.torn))
            got = run("record", "--from", "-", "-o", d("a"), "--continue", given=b"")
            expect(got.status == 2, "an import is gone on with: %s" % got.err)


def full_disk():
    """A limit of the file's size stands for the disk: one error, status 74, all that is there whole and told."""
    limit = 3 << 20
    with Folder() as d:
        got = run("record", "--from", "/dev/zero", "-o", d("a"), "--json",
                  preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))).ok(74)
        out = lines(got)
        end = [o for o in out if o.get("event") == "end"]
        errors = [o for o in out if "event" not in o]
        expect(len(end) == 1 and end[0]["ended"] == "error" and end[0]["error"]["file"] == d("a"), out)
        expect(len(errors) == 1 and errors[0]["error"]["code"] == "io", out)
        s = Spool(d("a"))
        expect(not s.torn and len(s.data) == end[0]["bytes"] == end[0]["durable"] and len(s.data) > limit - 600000, "%d" % len(s.data))


def full_tmpfs():
    if os.geteuid():
        print("skipped: full_tmpfs needs root")
        return
    with Folder() as d:
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2M", "tmpfs", d.path], stderr=subprocess.DEVNULL).returncode:
            print("skipped: no tmpfs can be mounted here")
            return
        try:
            got = run("record", "--from", "/dev/zero", "-o", d("a")).ok(74)
            s = Spool(d("a"))
            expect("no space" in got.err.lower() and "make room; %d of %d bytes are safe" % ((len(s.data),) * 2) in got.err, got.err)
            expect(len(s.data) > 1000000 and set(s.data) == {0}, "%d bytes" % len(s.data))
        finally:
            subprocess.run(["umount", d.path], check=True)


def told_to_systemd():
    with Folder() as d:
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        sock.bind(d("notify"))
        sock.settimeout(180)
        p = start("record", "--from", "-", "-o", d("a"), stdin=subprocess.PIPE, env={"NOTIFY_SOCKET": d("notify")})
        expect("READY=1" in sock.recv(4096).decode(), "not ready")
        p.stdin.write(b"x" * 5000)
        p.stdin.flush()
        expect("STATUS=" in sock.recv(4096).decode(), "no status")
        p.stdin.close()
        text = ""
        while "STOPPING=1" not in text:
            text = sock.recv(4096).decode()
        p.stdin = None
        finish(p).ok()
        sock.close()


def las_files():
    """Of LAS files in a spool, compressed ones are told as that, with what to do; so is where none is whole."""
    def las(n, packed=False):
        head = bytearray(227)
        head[:4] = b"LASF"
        head[24:26] = b"\1\2"
        struct.pack_into("<HI", head, 94, 227, 227)
        struct.pack_into("<BHI", head, 104, 0x80 if packed else 0, 20, n)
        return bytes(head) + bytes(20 * n)

    for dump, says in ((las(10, True) + las(7, True), ("compressed (LAZ, 2 of them)", "send LAS", "--to raw")),
                       (las(1000)[:5000], ("there is no whole LAS file in it (1 were not)",)),
                       (b"", ("there is no whole LAS file in it (0 were not)",))):
        with Folder() as d:
            with open(d("dump"), "wb") as f:
                f.write(dump)
            run("record", "--from", d("dump"), "--profile", "generic-las", "--profiles", PROFILES, "-o", d("a.spool"), "-q").ok()
            got = run("push", d("a.spool"), "-o", d("a.las"))
            expect(got.status == 1 and all(s in got.err for s in says) and "a.spool" in got.err, "%d %s" % (got.status, got.err))
            expect(not os.path.exists(d("a.las")), "something was written")


def idle():
    """A silent pipe costs no time: nothing wakes it."""
    with Folder() as d:
        p = start("record", "--from", "-", "-o", d("a"), stdin=subprocess.PIPE)
        until(lambda: os.path.exists(d("a")) and os.path.getsize(d("a")) == 8192, "no spool")
        rests(p.pid, 3, 0.011, 1.5)
        finish(p, b"").ok()


if __name__ == "__main__":
    scan.main(from_a_file, names_in_a_folder, limits, signals_are_a_good_end, a_pipe_that_nobody_writes_into, kill_and_go_on_reading, full_disk,
              full_tmpfs, told_to_systemd, las_files, idle)
