"""The simulated life of a dataset: pushes, replaced and reverted files, prunes, removals, lost caches, backups, kills of the
daemon and restarts, in random order. After each step some generation is meshed with some view, and both digests are compared with
a build from scratch of its live files by another daemon. Usage: years.py [STEPS [SEED...]]"""
import random
import sys

import e2e
from e2e import expect
from generations_model import Life

STEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 60
SEEDS = [int(s) for s in sys.argv[2:]] or [1, 2]


def life(seed, steps):
    with e2e.Folder() as base, e2e.Daemon(base, memory="32M", name="-oracle") as oracle:
        d = e2e.Daemon(base, memory=random.Random(seed).choice(["24M", "32M", "64M"]))
        with d:
            x = Life(base, d, oracle, random.Random(seed))
            for n in range(steps):
                try:
                    x.step()
                    x.check()
                except Exception as e:
                    raise e2e.Fault("seed %d, step %d: %s\n%s" % (seed, n, e, "\n".join(x.told[-12:])))
            x.check_all()
            r = d.ctl("cache", "verify")
            expect(r.status == 0, r.out + r.err)
        print("     seed %d: %s; %d of %d domains made" % (seed, x.counts(), x.made, x.domains), flush=True)


def lives():
    for seed in SEEDS:
        life(seed, STEPS)


e2e.main(lives)
