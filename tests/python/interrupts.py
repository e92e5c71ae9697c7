"""Ctrl-C at any moment raises KeyboardInterrupt, once, and leaves a connection that can be used, or is closed. Signals come at
random times during calls, and exceptions at each instruction in turn. Run under -X dev -W error."""
import contextlib
import gc
import os
import random
import signal
import sys
import threading
import time
import weakref

import acut
import e2e
from e2e import Daemon, Folder, expect
from module import SMALL, lost, raises, synth


def descriptors():
    return len(os.listdir("/proc/self/fd"))


came = False


def on_alarm(number, frame):
    global came
    came = True
    raise KeyboardInterrupt


def interrupted(work, seconds):
    """Sends a signal that many seconds after the start of the call, possibly after its end. True if it was raised."""
    global came
    came = False
    try:
        try:
            signal.setitimer(signal.ITIMER_REAL, seconds)
            work()
        finally:
            while not came:
                time.sleep(0.0001)
    except KeyboardInterrupt:
        return True
    return False


def in_long_calls():
    """Signals while a call waits, and in callbacks of long calls."""
    with Folder() as base, Daemon(base, **SMALL) as d, acut.connect(d.socket) as c:
        c.push("s", synth(os.path.join(base, "a.las"), 200000))
        extra = [synth(os.path.join(base, "x%d.las" % i), 1000, i) for i in range(30)]
        done = c.wait(c.submit("s"))
        # While a call waits for an answer that does not come: the daemon is stopped.
        os.kill(d.process.pid, signal.SIGSTOP)
        try:
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
            c.ping()
            expect(False, "a stopped daemon has answered")
        except KeyboardInterrupt:
            pass  # the call has ended, and the daemon is still stopped
        raises(acut.TimedOutError, acut.connect, d.socket, timeout=0.2)
        os.kill(d.process.pid, signal.SIGCONT)
        expect(c.ping() < e2e.PATIENCE, "the connection is gone")
        rng = random.Random(3)
        works = [lambda: c.mesh(done, progress=lambda p: None), lambda: c.wait(c.submit("s", new=True), changed=lambda j: None),
                 lambda: c.push("t", extra, progress=lambda p: None, replace=True), lambda: c.jobs()]
        for i in range(60):
            expect(interrupted(works[i % len(works)], rng.uniform(0.0005, 0.06)), "interrupt %d did not come through" % i)
        expect(not lost, lost)
        expect(c.mesh(done).digest == done.report.digest, "another mesh")
        for job in c.jobs():
            if not job.final:
                c.cancel(job)


class Scene:
    """A daemon with a job that is done, a connection, and calls to be interrupted. None drops an open object: Python prints
    exceptions of finalizers, also a KeyboardInterrupt of the test."""

    def __init__(self, base, d):
        self.d, self.c = d, acut.connect(d.socket)
        self.file = synth(os.path.join(base, "a.las"), 500)
        self.c.push("s", self.file)
        self.job = self.c.wait(self.c.submit("s"))
        self.fetches = [self.fetch, self.left, self.steps, self.mesh]
        self.calls = [self.ping, self.jobs, self.job_of, self.build, self.refusal, *self.fetches, self.open_close]
        for call in self.calls:
            call()

    def ping(self):
        self.c.ping()

    def jobs(self):
        self.c.jobs()

    def job_of(self):
        self.c.job(self.job)

    def build(self):
        self.c.daemon_build, self.c.fileno()

    def refusal(self):
        raises(acut.NotFoundError, self.c.dataset, "no such dataset")

    def fetch(self):
        with self.c.fetch(self.job) as blocks:
            for block in blocks:
                blocks.state()

    def left(self):
        with self.c.fetch(self.job) as blocks:
            next(blocks)
        self.c.ping()

    def steps(self):
        blocks = self.c.fetch(self.job)
        blocks.head
        next(blocks)
        blocks.close()
        blocks.close()

    def mesh(self):
        self.c.mesh(self.job)

    def push(self):
        self.c.push("s", self.file)

    def open_close(self):
        with acut.connect(self.d.socket) as c:
            c.ping()
            c.close()

    def whole(self, text):
        """Checks that the connection works, and that no exception was lost."""
        try:
            self.c.ping()
        except acut.Error as e:
            raise e2e.Fault("after %s: %s" % (text, e))
        expect(not lost, "%s: %s" % (text, lost))


def in_short_calls():
    """Thousands of signals during short calls."""
    with Folder() as base, Daemon(base, **SMALL) as d:
        scene, rng = Scene(base, d), random.Random(5)
        before = descriptors()
        for call in scene.calls:
            start = time.perf_counter()
            call()
            most = 1.2 * (time.perf_counter() - start)
            for i in range(300):
                expect(interrupted(call, rng.uniform(1e-6, most)), "interrupt %d of %s did not come through" % (i, call.__name__))
                scene.whole("interrupt %d of %s" % (i, call.__name__))
        gc.collect()
        expect(descriptors() == before, "%d descriptors more" % (descriptors() - before))
        expect(scene.c.mesh(scene.job).digest == scene.job.report.digest, "another mesh")
        scene.c.close()


class Instructions:
    """The instructions that are executed in the module, and in the standard modules that close resources for it: each instruction
    once for each calling function. KeyboardInterrupt is raised before the `chosen` one, also where the interpreter never checks
    for signals."""

    files = tuple(os.path.join(os.path.dirname(acut.__file__), n) for n in os.listdir(os.path.dirname(acut.__file__)))
    files += (contextlib.__file__, weakref.__file__)

    def __init__(self, chosen=None):
        self.chosen, self.seen, self.came = chosen, {}, False

    def __call__(self, frame, event, arg):
        if frame.f_code.co_filename not in self.files:
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        if event == "exception" and arg[0] is GeneratorExit:
            # A generator of `guard` ends. There it makes no call after which the interpreter would check for signals.
            frame.f_trace_opcodes = False
        elif event == "opcode":
            at = frame.f_code, frame.f_lasti, frame.f_back.f_code
            if at == self.chosen:
                self.came = True
                raise KeyboardInterrupt  # this ends the tracing, too
            self.seen[at] = True
        return self


def run(call, chosen=None, after=lambda: None):
    """Returns the executed instructions. `after` is called if the interrupt came, while its exception is still referenced."""
    instructions = Instructions(chosen)
    try:
        sys.settrace(instructions)
        try:
            call()
        finally:
            sys.settrace(None)
    except KeyboardInterrupt:
        after()
    else:
        expect(not instructions.came, "it got lost: %s" % lost)
    return instructions.seen


def at_every_instruction():
    """Instructions that an earlier call has executed are skipped."""
    with Folder() as base, Daemon(base, **SMALL) as d:
        scene, had = Scene(base, d), set()
        gc.collect()
        gc.disable()  # interrupted objects must be freed without the collector
        before = descriptors()
        for call in scene.calls + [scene.push]:
            new = [at for at in run(call) if at not in had]
            expect(len(new) > 10, "%s has %d instructions" % (call.__name__, len(new)))
            had.update(new)
            for at in new:
                text = "%s, interrupted in %s before %d, called by %s" % (call.__name__, at[0].co_name, at[1], at[2].co_name)
                # Only a fetch may still be referenced by the exception.
                run(call, at, after=lambda: None if call in scene.fetches else scene.whole(text))
                scene.whole(text)
                if descriptors() != before:
                    gc.collect()  # frames of contextlib, in a reference cycle
                # A file may only stay open after an interrupt just before the call that closes it, where no signal is handled.
                expect(descriptors() == before or at[0].co_name == "opened", text + ": a descriptor is left")
                before = descriptors()
        gc.enable()
        scene.c.close()


signal.signal(signal.SIGALRM, on_alarm)
e2e.main(in_long_calls, in_short_calls, at_every_instruction)
