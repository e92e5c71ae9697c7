"""acutctl against a fake daemon whose answers are rare: those of an older version, and of a push that failed between two
requests."""
import json
import os
import socket
import sys
import tempfile
import threading

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from e2e import expect, main  # noqa: E402

try:
    import xxhash  # noqa: E402,F401 (acut_wire needs it)
    import acut_wire  # noqa: E402
    from acut_wire import pb  # noqa: E402
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)


class Fake:
    """One connection at a time. `answers`: the answer to each request, by the name of the request; other answers are empty."""

    ANSWERS = dict(acut_wire.Client.ANSWERS, datasets_request="datasets")

    def __init__(self, path, **answers):
        self.path, self.answers = path, answers
        self.door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.door.bind(path)
        self.door.listen(4)
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.door.shutdown(socket.SHUT_RDWR)
        self.thread.join()
        self.door.close()
        os.unlink(self.path)

    def serve(self):
        while True:
            try:
                sock, _ = self.door.accept()
            except OSError:
                return
            wire = acut_wire.Wire.__new__(acut_wire.Wire)
            wire.sock, wire.timeout = sock, None
            try:
                while True:
                    self.answer(wire, *wire.recv())
            except (acut_wire.Gone, ConnectionError):
                sock.close()

    def answer(self, wire, number, question, fd):
        if fd >= 0:
            os.close(fd)
        kind, answer = question.WhichOneof("body"), pb.Message()
        given = self.answers.get(kind)
        if kind == "hello":
            answer.hello.CopyFrom(pb.Hello(version_min=1, version_max=1, build="older"))
        elif isinstance(given, pb.Error):
            answer.error.CopyFrom(given)
        else:
            body = getattr(answer, self.ANSWERS[kind])
            body.SetInParent()
            if given is not None:
                body.CopyFrom(given)
        wire.send(number, answer)


def push(fake, *args):
    return e2e.run([e2e.ACUTCTL, "--socket", fake.path, "push", "s", *args])


def scene():
    base = tempfile.TemporaryDirectory(prefix="acut-answers-")
    path = os.path.join(base.name, "empty.xyz")
    with open(path, "w"):
        pass
    return base, os.path.join(base.name, "sock"), path


def an_older_daemon_makes_a_generation():
    """In older versions a push without new points made a generation. The answer tells which is true, and acutctl reports that."""
    base, sock, path = scene()
    with base:
        for unchanged in (False, True):
            done = pb.PushCommitted(dataset="s", generation=8, points=500)
            if unchanged:
                done.unchanged = True
            with Fake(sock, push_begin=pb.PushBegun(push=1), push_commit=done) as fake:
                text, told = push(fake, path), push(fake, path, "--json")
            expect(text.status == 0 and told.status == 0, text.err + told.err)
            expect(("nothing to commit" in text.out) == unchanged, text.out)
            expect(("generation 8, 500 points" in text.out) == (not unchanged), text.out)
            got = json.loads(told.out)
            expect((got["state"], got["generation"]) == ("empty" if unchanged else "staged", 8), got)


def what_is_about_the_push():
    """The error of a failed push is the answer to the next request; acutctl does not attribute it to the file of that request."""
    base, sock, path = scene()
    cases = (
        ("no-space", "push", "the push into s cannot go on: the disk is full", False, 74),
        ("does-not-fit", "push", "the push into s cannot go on: it takes too much", False, 1),
        ("io", "", "an older daemon, of its catalogue", False, 74),
        ("bad-input", "", "an older daemon, of this file", True, 1),
    )
    with base:
        for kind in ("probe", "file"):
            for code, field, message, named, status in cases:
                why = pb.Error(code=code, field=field, message=message)
                with Fake(sock, push_begin=pb.PushBegun(push=1), **{kind: why}) as fake:
                    text, told = push(fake, path), push(fake, path, "--json")
                expect((text.status, told.status) == (status, status), "%s: %s %s" % (code, text.err, told.out))
                expect(text.err.splitlines()[0] == "acutctl: %s%s" % (path + ": " if named else "", message), text.err)
                got = json.loads(told.out.splitlines()[0])["error"]
                expect(got["file"] == (path if named else None) and got["message"] == message, got)


main(an_older_daemon_makes_a_generation, what_is_about_the_push)
