"""Pipes with announced content: they are recognised, resumed and replaced like files. Other content is refused and leaves
nothing."""
import os

import e2e
from e2e import Daemon, Folder, expect

try:
    import xxhash
    from acut_wire import Client, Refused, pb
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)


def survey(base, seed):
    path = os.path.join(base, "%d.las" % seed)
    e2e.run([e2e.SYNTH, "--points", "20000", "--seed", str(seed), path]).ok()
    return open(path, "rb").read()


def xyz(base, seed):
    return b"".join(b"%d.%d %d %d\n" % (i * 7 % 1000, i % 10, i * 11 % 997, (i + seed) % 50) for i in range(20000))


def hash_of(data):
    return xxhash.xxh3_128_hexdigest(data)


class Push:
    def __init__(self, c, dataset, **begin):
        self.c = c
        self.begun = c.ask("push_begin", pb.PushBegin(dataset=dataset, **begin))
        self.push = self.begun.push

    def stream(self, data, name="a", path=b"who", known=False, send=None, **probe):
        """Announces `data`, sends `send`; returns the answer to the probe."""
        fmt = "las" if data[:4] == b"LASF" else "xyz"
        _, fd = self.c.answer(self.c.send("stream", pb.Stream(push=self.push, name=name)), "streaming")
        child = 0
        if not known:
            child = os.fork()
            if not child:
                try:
                    with os.fdopen(fd, "wb") as f:
                        f.write(data if send is None else send)
                finally:
                    os._exit(0)
        try:
            ask = dict(push=self.push, name=name, format=fmt, path=path, hash=hash_of(data), size=len(data), checksum=True)
            if known:
                # only what a probe must see
                os.write(fd, data[:4000])
            ask.update(probe)
            os.close(fd)
            fd = -1
            got = self.c.ask("probe", pb.Probe(**ask))
            if got.known:
                return got
            self.c.ask("push_plan", pb.PushPlan(push=self.push))
            self.c.ask("file", pb.File(push=self.push, name=name, format=fmt))
            return got
        finally:
            if fd >= 0:
                os.close(fd)
            if child:
                os.waitpid(child, 0)

    def commit(self):
        return self.c.ask("push_commit", pb.PushCommit(push=self.push))


def refused(code, call, *args, **kw):
    try:
        call(*args, **kw)
    except Refused as e:
        expect(e.code == code, "%s, not %s" % (e, code))
        return str(e)
    raise e2e.Fault("it was not refused: %s" % code)


def told_by_content(make):
    with Folder() as base, Daemon(base) as d:
        first, second = make(base, 1), make(base, 2)
        with Client(d.socket) as c:
            p = Push(c, "s")
            expect(p.stream(first).known == 0, "known before")
            expect(p.commit().points == 20000, "points")
            p = Push(c, "s")
            expect(p.stream(first, known=True).known == 1, "not known")
            expect(p.commit().generation == 1, "a generation for nothing")
            p = Push(c, "s")
            expect(p.stream(first, path=b"elsewhere", known=True).known == 1, "not known under another path")
            p.commit()
            p = Push(c, "s")
            refused("bad-input", p.stream, second)
            p = Push(c, "s")
            p.stream(second, replace=True)
            done = p.commit()
            expect((done.generation, done.points) == (2, 20000), str(done))
            # without what will come a pipe is always taken
            p = Push(c, "s")
            p.stream(second, hash="", path=b"who")
            expect(p.commit().points == 40000, "not taken")


def las():
    told_by_content(survey)


def text():
    told_by_content(xyz)


def held_to_it():
    with Folder() as base, Daemon(base) as d:
        data, other = survey(base, 1), survey(base, 2)
        small = bytearray(data)
        small[-5] ^= 1
        with Client(d.socket) as c:
            for i, (send, code) in enumerate(((bytes(small), "changed"), (data + b"x", "changed"), (data[:-1], "truncated"), (other, "changed"))):
                p = Push(c, "s%d" % i)
                refused(code, p.stream, data, send=send)
                p.stream(other, "b", b"other")
                done = p.commit()
                expect(done.points == 20000, "what was refused is there: %s" % done)
            lines = xyz(base, 1)
            p = Push(c, "t")
            refused("changed", p.stream, lines, send=lines[:-40])
            p = Push(c, "u")
            refused("usage", p.stream, data, hash="12", known=True)
            refused("usage", p.stream, data, "c", hash="g" * 32, known=True)
            refused("changed", p.stream, data, "d", size=len(data) + 1)


def taken_up():
    """The client leaves when one of two is staged; the next push takes it up."""
    with Folder() as base, Daemon(base) as d:
        first, second = survey(base, 1), survey(base, 2)
        with Client(d.socket) as c:
            p = Push(c, "s")
            p.stream(first)
        with Client(d.socket) as c:
            p = Push(c, "s")
            expect("taken over" in p.begun.note, p.begun.note)
            expect(p.stream(first, known=True).known == 2, "not taken up")
            p.stream(second, "b", b"other")
            expect(p.commit().points == 40000, "points")


e2e.main(las, text, held_to_it, taken_up)
