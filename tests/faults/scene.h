/*
 * The work of the tests of faults: three files are pushed into a service (tests/service/fixture.h), one at a time and with an
 * interruption, and lines into another dataset; each generation has jobs; the log has a mark for each acknowledgement. And the
 * checks of a service that is opened on the store after a fault.
 */
#ifndef SCENE_H
#define SCENE_H

#include "fixture.h"
#include "log.h"

#include <sys/wait.h>
#include <time.h>

#include "fault_io.h"

#define SCENE_MEMORY (UINT64_C(24) << 20)
#define OTHER_VIEW "view 1 every=3"

enum { FILES = 3, POINTS = 3000 };

/* Acknowledged, in this order. */
enum mark {
	MARK_GENERATION_1 = 1, /* a: file 1 */
	MARK_JOB,              /* of generation 1 */
	MARK_JOB_DONE,
	MARK_PENDING,      /* a: file 2, of an interrupted push */
	MARK_GENERATION_2, /* a: files 2 and 3 */
	MARK_SELECTED,     /* a job with a selection, of generation 2 */
	MARK_SELECTED_DONE,
	MARK_OTHER,    /* b: file 1 */
	MARK_OTHER_3,  /* b: files 2 and 3, a push each */
	MARK_REVERTED, /* b: file 3 is gone again */
	MARK_OTHER_5,  /* b: file 4; there are four segments now, which become one */
	MARK_PRUNING,  /* b: only the newest generation stays: begun */
	MARK_PRUNED,
	MARK_KEPT,     /* c: file 1 */
	MARK_REMOVING, /* c */
	MARK_REMOVED,
	MARK_RESTORED,
	MARK_LINES,          /* e: file 1, then lines 1 and 2, a push each */
	MARK_LINES_REVERTED, /* e: lines 1 are gone, which makes a line set */
	MARK_LINES_REPLACED, /* e: lines 3 in place of 2 */
	MARK_LINES_ASKED,    /* a mesh of the generation with lines 1 and 2 */
	MARK_LINES_PRUNING,  /* e: only the newest generation stays: begun */
	MARK_LINES_PRUNED,
	MARK_BETWEEN_PENDING, /* f: files 2, 3 and 4, of an interrupted push */
	MARK_BETWEEN,         /* f: file 1 */
	MARK_BETWEEN_PARTLY,  /* f: file 2, of the interrupted push, and file 5 */
	MARK_BETWEEN_ALL,     /* f: files 3 and 4, which were still pending */
};

/* What the meshes are, whatever happens. */
struct scene_digests {
	char one[DIGEST_HEX_SIZE], all[DIGEST_HEX_SIZE], selected[DIGEST_HEX_SIZE];
	char reverted[DIGEST_HEX_SIZE], pruned[DIGEST_HEX_SIZE];
	char lines[3][DIGEST_HEX_SIZE]; /* e: both, reverted, replaced */
	char between[DIGEST_HEX_SIZE];  /* f: all files */
	uint64_t job, selected_job;
};

/* ---- steps that may fail ---- */

/* As open_service, but it may fail. */
static int service_try_open(uint64_t memory, unsigned threads, struct err *err)
{
	struct service_params p = {.core = {.threads = threads}};
	char path[128];
	int r;

	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	memset(&h.ledger, 0, sizeof h - offsetof(struct fixture, ledger));
	h.statefd = open(h.folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	h.cachefd = dup(h.statefd);
	h.ledger = ledger_new(memory);
	ledger_reserve(h.ledger, LEDGER_MESSAGE, 1 << 20, 0);
	ledger_reserve(h.ledger, LEDGER_CATALOGUE, CATALOGUE_HEAP + CATALOGUE_QUEUE, 0);
	r = sched_new(h.ledger, threads, &h.sched, err);
	if (!r)
		r = catalogue_new(path, h.ledger, &h.catalogue, err);
	p.core.ledger = h.ledger;
	p.core.sched = h.sched;
	p.core.catalogue = h.catalogue;
	p.core.statefd = h.statefd;
	p.core.cachefd = h.cachefd;
	if (!r)
		r = service_new(&p, &h.service, err);
	if (!r)
		return 0;
	sched_free(h.sched);
	catalogue_free(h.catalogue);
	close(h.statefd);
	close(h.cachefd);
	ledger_free(h.ledger);
	return r;
}

/* 0 or the code of the error, which is in got.why. The push stays open in any case if there is one. */
static enum err_code push_some(const char *dataset, const unsigned *seeds, unsigned n, unsigned staged, bool commit,
			       enum push_known_as *ret_known)
{
	struct push_input input[FILES] = {{.checksum = true}, {.checksum = true}, {.checksum = true}};
	enum push_known_as known[FILES];
	char name[FILES][16];
	int fd[FILES];

	begin(dataset);
	for (unsigned i = 0; i < n; i++) {
		snprintf(name[i], sizeof name[i], "%u.xyz", seeds[i]);
		input[i].name = input[i].path = name[i];
		fd[i] = text_file(POINTS, seeds[i]);
	}
	for (unsigned i = 0; i < n && !got.why.code; i++) {
		ask(push_probe(got.push, dup(fd[i]), &input[i], NULL));
		known[i] = got.known;
	}
	if (!got.why.code)
		ask(push_plan(got.push, NULL));
	for (unsigned i = 0; i < staged && !got.why.code; i++)
		if (known[i] == PUSH_NEW)
			ask(push_file(got.push, dup(fd[i]), &input[i], NULL));
	if (!got.why.code && commit)
		ask(push_commit(got.push, NULL));
	for (unsigned i = 0; i < n; i++)
		close(fd[i]);
	if (!got.why.code && ret_known)
		memcpy(ret_known, known, n * sizeof *known);
	return got.why.code;
}

/* Likewise, of a file of lines. */
static enum err_code push_lines(const char *dataset, const char *name, unsigned seed, bool replace)
{
	const struct push_input input = {.name = name, .path = name, .checksum = true, .replace = replace};
	int fd = lines_file(8, seed);

	begin(dataset);
	if (!got.why.code)
		ask(push_probe(got.push, dup(fd), &input, NULL));
	if (!got.why.code)
		ask(push_plan(got.push, NULL));
	if (!got.why.code && got.known == PUSH_NEW)
		ask(push_file(got.push, dup(fd), &input, NULL));
	if (!got.why.code)
		ask(push_commit(got.push, NULL));
	close(fd);
	return got.why.code;
}

static void push_end(void)
{
	if (got.push)
		push_leave(got.push);
	if (got.committed.dataset)
		dataset_release(got.committed.dataset);
	got.push = NULL;
	got.committed.dataset = NULL;
}

static struct job *submit_at(struct dataset *d, uint64_t generation, const char *view)
{
	struct job_params p = {.dataset = d, .generation = generation, .view = view, .peer = me};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	return accepted_job;
}

/* ---- the play, which must go well ---- */

#define must(what)                                                                                                 \
	do {                                                                                                       \
		if (!(what)) {                                                                                     \
			printf("%s:%d: %s; %s: %s %s\n", __FILE__, __LINE__, #what, got.why.file, got.why.message, \
			       accepted_err.message);                                                              \
			fflush(stdout);                                                                            \
			_exit(1);                                                                                  \
		}                                                                                                  \
	} while (0)

static void mesh_to(struct job *job, char digest[DIGEST_HEX_SIZE])
{
	turn_until_final(job);
	if (info_of(job).state != JOB_done) {
		printf("job %llu: %s %s %s\n", (unsigned long long)info_of(job).id, job_state_text(info_of(job).state),
		       info_of(job).err ? info_of(job).err->file : "", info_of(job).err ? info_of(job).err->message : "");
		fflush(stdout);
		_exit(1);
	}
	snprintf(digest, DIGEST_HEX_SIZE, "%s", info_of(job).report->digest);
}

static void mesh_at(const char *name, uint64_t generation, char digest[DIGEST_HEX_SIZE])
{
	struct dataset *d = dataset_find(h.service->datasets, name, &me);
	struct job *job;

	must(d && (job = submit_at(d, generation, VIEW)));
	mesh_to(job, digest);
}

static void reverted(void *token, const struct err *why, const struct reverted *did)
{
	answer(why);
}

static void pruned(void *token, const struct err *why, const struct pruned *did)
{
	answer(why);
}

static void verbed(void *token, const struct err *why, struct dataset *d)
{
	answer(why);
}

static void push_one(const char *name, unsigned seed)
{
	must(!push_some(name, &seed, 1, 1, true, NULL));
	push_end();
}

static void verb(enum dataset_action what, const char *name)
{
	struct dataset_action_params w = {.action = what, .name = name, .as = "", .peer = me};

	ask(dataset_act(h.service->datasets, &w, verbed, NULL));
	must(!got.why.code);
}

/* What becomes of generations and datasets. */
static void play_on(struct scene_digests *ret)
{
	push_one("b", 1);
	fault_mark(MARK_OTHER);
	push_one("b", 2);
	push_one("b", 3);
	/* What the next commit brings to the disk: the rows of b's pushes are gone, by which a start would look into its folder.
	 */
	turn_until(!service_active(h.service));
	push_one("d", 1);
	fault_mark(MARK_OTHER_3);
	ask(dataset_revert(dataset_find(h.service->datasets, "b", &me), 0, &me, reverted, NULL));
	must(!got.why.code);
	fault_mark(MARK_REVERTED);
	mesh_at("b", 0, ret->reverted);
	push_one("b", 4);
	fault_mark(MARK_OTHER_5);
	mesh_at("b", 0, ret->pruned);
	turn_until(!service_active(h.service));
	fault_mark(MARK_PRUNING);
	ask(dataset_prune(dataset_find(h.service->datasets, "b", &me), 1, 0, &me, pruned, NULL));
	must(!got.why.code);
	fault_mark(MARK_PRUNED);
	push_one("c", 1);
	fault_mark(MARK_KEPT);
	turn_until(!service_active(h.service));
	fault_mark(MARK_REMOVING);
	verb(DATASET_REMOVE, "c");
	fault_mark(MARK_REMOVED);
	verb(DATASET_RESTORE, "c");
	fault_mark(MARK_RESTORED);
}

static void lines_one(const char *name, unsigned seed, bool replace)
{
	must(!push_lines("e", name, seed, replace));
	push_end();
}

/* What becomes of lines. */
static void play_lines(struct scene_digests *ret)
{
	char again[DIGEST_HEX_SIZE];

	push_one("e", 1);
	lines_one("1.txt", 1, false);
	lines_one("2.txt", 2, false);
	fault_mark(MARK_LINES);
	mesh_at("e", 0, ret->lines[0]);
	ask(dataset_revert(dataset_find(h.service->datasets, "e", &me), 2, &me, reverted, NULL));
	must(!got.why.code);
	fault_mark(MARK_LINES_REVERTED);
	mesh_at("e", 0, ret->lines[1]);
	lines_one("2.txt", 3, true);
	fault_mark(MARK_LINES_REPLACED);
	mesh_at("e", 0, ret->lines[2]);
	/* Its line set went, or will. */
	turn_until(!service_active(h.service));
	mesh_at("e", 3, again);
	must(!strcmp(again, ret->lines[0]) && strcmp(again, ret->lines[1]) && strcmp(again, ret->lines[2]));
	turn_until(!service_active(h.service));
	fault_mark(MARK_LINES_ASKED);
	fault_mark(MARK_LINES_PRUNING);
	ask(dataset_prune(dataset_find(h.service->datasets, "e", &me), 1, 0, &me, pruned, NULL));
	must(!got.why.code);
	fault_mark(MARK_LINES_PRUNED);
}

static void wait_pending(const char *name, unsigned files)
{
	struct dataset *d;
	struct dataset_info info;

	turn_until((d = dataset_find(h.service->datasets, name, &me)) && (dataset_info(d, &info), info.pending_files == files));
}

/* What becomes of an interrupted push when others come before its repetition. */
static void play_between(struct scene_digests *ret)
{
	static const unsigned left[] = {2, 3, 4}, some[] = {2, 5};
	enum push_known_as known[FILES];

	must(!push_some("f", left, 3, 3, false, NULL));
	push_end();
	wait_pending("f", 3);
	fault_mark(MARK_BETWEEN_PENDING);
	push_one("f", 1);
	fault_mark(MARK_BETWEEN);
	must(!push_some("f", some, 2, 2, true, known) && known[0] == PUSH_ADOPTED);
	fault_mark(MARK_BETWEEN_PARTLY);
	push_end();
	wait_pending("f", 2);
	must(!push_some("f", left + 1, 2, 2, true, known) && known[0] == PUSH_ADOPTED && known[1] == PUSH_ADOPTED);
	fault_mark(MARK_BETWEEN_ALL);
	push_end();
	mesh_at("f", 0, ret->between);
}

static void play(struct scene_digests *ret)
{
	static const unsigned seed[FILES] = {1, 2, 3};
	struct dataset *a;
	struct dataset_info info;
	struct job *job;

	must(!push_some("a", seed, 1, 1, true, NULL));
	fault_mark(MARK_GENERATION_1);
	push_end();
	a = dataset_find(h.service->datasets, "a", &me);
	must(a && (job = submit_at(a, 0, VIEW)));
	fault_mark(MARK_JOB);
	ret->job = info_of(job).id;
	mesh_to(job, ret->one);
	turn_until(!catalogue_busy(h.catalogue));
	fault_mark(MARK_JOB_DONE);
	must(!push_some("a", seed + 1, 1, 1, false, NULL));
	push_end();
	turn_until((dataset_info(a, &info), info.pending == 1));
	must(info.pending_files == 1);
	fault_mark(MARK_PENDING);
	must(!push_some("a", seed + 1, 2, 2, true, NULL));
	fault_mark(MARK_GENERATION_2);
	push_end();
	must((job = submit_at(a, 0, OTHER_VIEW)));
	fault_mark(MARK_SELECTED);
	ret->selected_job = info_of(job).id;
	mesh_to(job, ret->selected);
	turn_until(!catalogue_busy(h.catalogue));
	fault_mark(MARK_SELECTED_DONE);
	mesh_at("a", 0, ret->all);
	play_on(ret);
	play_lines(ret);
	play_between(ret);
	turn_until(!service_active(h.service));
}

/* ---- after a fault ---- */

#define has(m) (marks >= (m))

/* Checks the results of play_on. */
static void check_on(uint64_t marks, const struct scene_digests *want)
{
	char digest[DIGEST_HEX_SIZE];
	struct err err = ERR_INIT;

	must(!has(MARK_OTHER) || dataset_find(h.service->datasets, "b", &me));
	if (has(MARK_OTHER_3) && !has(MARK_PRUNING)) {
		mesh_at("b", 3, digest);
		must(!strcmp(digest, want->all));
		mesh_at("b", 1, digest);
		must(!strcmp(digest, want->one));
	}
	if (has(MARK_REVERTED) && !has(MARK_PRUNING)) {
		mesh_at("b", 4, digest);
		must(!strcmp(digest, want->reverted));
	}
	if (has(MARK_OTHER_5)) {
		mesh_at("b", 5, digest);
		must(!strcmp(digest, want->pruned));
	}
	must(!has(MARK_PRUNED) || dataset_check_generation(dataset_find(h.service->datasets, "b", &me), 3, &err));
	if (has(MARK_REMOVED) && !has(MARK_RESTORED) && !dataset_find(h.service->datasets, "c", &me)) {
		must(dataset_removed_after(h.service->datasets, 0, &me));
		verb(DATASET_RESTORE, "c");
	}
	if (has(MARK_KEPT) && (!has(MARK_REMOVING) || has(MARK_REMOVED))) {
		mesh_at("c", 0, digest);
		must(!strcmp(digest, want->one));
	}
}

/* Of play_lines. */
static void check_lines(uint64_t marks, const struct scene_digests *want)
{
	char digest[DIGEST_HEX_SIZE];

	for (unsigned i = 0; i < 3; i++) {
		/* The newest generation stays. */
		if (!has((uint64_t)MARK_LINES + i) || (i < 2 && has(MARK_LINES_PRUNING)))
			continue;
		mesh_at("e", 3 + i, digest);
		must(!strcmp(digest, want->lines[i]));
	}
}

/* What nobody names again stays for 7 days. They are over. */
static void end_pending(void)
{
	struct dataset *next;

	for (struct dataset *d = datasets_first(h.service->datasets); d; d = next) {
		next = d->next;
		for (struct pending *q; (q = d->pending);)
			pending_drop(d, pending_take(d, q->id, q->stamp), "it is of no use any more");
	}
}

/* Of play_between: nothing that was durable is read again, and each file is there once. */
static void check_between(uint64_t marks, const struct scene_digests *want)
{
	static const unsigned first[] = {2, 3, 4}, others[] = {1, 5};
	enum push_known_as known[FILES];
	struct dataset_info info;
	char digest[DIGEST_HEX_SIZE];

	must(!push_some("f", first, 3, 3, true, known));
	for (unsigned i = 0; i < 3; i++)
		must(!has(MARK_BETWEEN_PENDING) || known[i] != PUSH_NEW);
	must(!has(MARK_BETWEEN_PARTLY) || known[0] == PUSH_KNOWN);
	must(!has(MARK_BETWEEN_ALL) || (known[1] == PUSH_KNOWN && known[2] == PUSH_KNOWN));
	push_end();
	must(!push_some("f", others, 2, 2, true, known));
	must(!has(MARK_BETWEEN) || known[0] == PUSH_KNOWN);
	must(!has(MARK_BETWEEN_PARTLY) || known[1] == PUSH_KNOWN);
	push_end();
	wait_pending("f", 0);
	dataset_info(dataset_find(h.service->datasets, "f", &me), &info);
	must(info.files == 5 && info.points == UINT64_C(5) * POINTS);
	mesh_at("f", 0, digest);
	must(!strcmp(digest, want->between));
}

/* All that was acknowledged is there and right; then the rest is done, and the whole is right too. */
static void check_all(uint64_t marks, const struct scene_digests *want)
{
	static const unsigned seed[FILES] = {1, 2, 3};
	struct dataset *a = dataset_find(h.service->datasets, "a", &me), *b;
	enum push_known_as known[FILES];
	char digest[DIGEST_HEX_SIZE];
	struct job *job;

	if (has(MARK_GENERATION_1)) {
		must(a && (job = submit_at(a, 1, VIEW)));
		mesh_to(job, digest);
		must(!strcmp(digest, want->one));
	}
	if (has(MARK_JOB)) {
		must((job = job_find(h.service->jobs, want->job, &me)));
		must(!has(MARK_JOB_DONE) || info_of(job).state == JOB_done);
		mesh_to(job, digest);
		must(!strcmp(digest, want->one));
	}
	if (has(MARK_SELECTED)) {
		must((job = job_find(h.service->jobs, want->selected_job, &me)));
		must(!has(MARK_SELECTED_DONE) || info_of(job).state == JOB_done);
		mesh_to(job, digest);
		must(!strcmp(digest, want->selected));
	}
	check_on(marks, want);
	check_lines(marks, want);
	must(!push_some("a", seed, FILES, FILES, true, known));
	must(!has(MARK_GENERATION_1) || known[0] == PUSH_KNOWN);
	must(!has(MARK_PENDING) || known[1] != PUSH_NEW);
	must(!has(MARK_GENERATION_2) || (known[1] == PUSH_KNOWN && known[2] == PUSH_KNOWN));
	push_end();
	must((job = submit_at(dataset_find(h.service->datasets, "a", &me), 0, VIEW)));
	mesh_to(job, digest);
	must(!strcmp(digest, want->all));
	check_between(marks, want);
	/* A revert or a prune leaves no word in the catalogue that a start would clean up by: the next commit does. */
	if ((b = dataset_find(h.service->datasets, "b", &me)) && b->generation)
		push_one("b", 100 + (unsigned)b->generation);
	if ((b = dataset_find(h.service->datasets, "e", &me)) && b->generation)
		lines_one("last.txt", 100 + (unsigned)b->generation, true);
	end_pending();
	turn_until(!service_active(h.service));
}

#undef has

static int bad_names;
static bool after_crash, keeps_manifests;

static bool is_manifest(const char *name)
{
	return !strncmp(name, "manifest-", 9);
}

static bool is_of_manifest(const char *name)
{
	return is_manifest(name) || !strncmp(name, "sources-", 8);
}

static int look(const char *path, const struct stat *st, int kind, struct FTW *ftw)
{
	const char *name = path + ftw->base, *dot = strrchr(name, '.');
	static const char *const ends[] = {".tmp", ".run", ".pending", ".part", ".stage", ".new"};
	bool bad = !strncmp(name, "tmp-", 4);

	/* What a crash leaves in the store of domains is evicted like all that is there. */
	if (kind != FTW_F || (after_crash && strstr(path, "/domains/")) || (keeps_manifests && is_of_manifest(name)))
		return 0;
	for (unsigned i = 0; dot && i < sizeof ends / sizeof *ends; i++)
		bad |= !strcmp(dot, ends[i]);
	bad |= strstr(path, "/tmp/") && strstr(strstr(path, h.folder) + strlen(h.folder), "/tmp/");
	bad |= strstr(path, "/one-step/") != NULL;
	if (bad)
		printf("left behind: %s\n", path);
	bad_names += bad;
	return 0;
}

/* Whether one of the manifests there names it. */
static bool is_named(int fd, DIR *dir, const char *name)
{
	struct dirent *e;
	bool named = false;

	rewinddir(dir);
	while (!named && (e = readdir(dir))) {
		struct grid_manifest *m = NULL;
		struct err err = ERR_INIT;

		if (!is_manifest(e->d_name) || (keeps_manifests && strstr(e->d_name, ".tmp")))
			continue;
		must(!grid_manifest_read(fd, e->d_name, &m, &err));
		named = grid_manifest_has_file(m, name);
		grid_manifest_free(m);
	}
	return named;
}

/* A folder of a dataset: a manifest, and what it names. */
static void look_dataset(const char *path)
{
	int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC), manifests = 0;
	DIR *dir = opendir(path), *other = opendir(path);
	struct dirent *e;

	while ((e = readdir(dir))) {
		if (*e->d_name == '.')
			continue;
		if (is_manifest(e->d_name)) {
			if (manifests++ == 0 || keeps_manifests)
				continue;
		} else if (is_named(fd, other, e->d_name) || (keeps_manifests && is_of_manifest(e->d_name))) {
			continue;
		}
		printf("left behind: %s/%s\n", path, e->d_name);
		bad_names++;
	}
	closedir(dir);
	closedir(other);
	close(fd);
}

/* No half file, no temporary one, nothing that nobody names. */
static bool clean(void)
{
	char path[sizeof h.folder + 16];
	DIR *dir;
	struct dirent *e;

	bad_names = 0;
	nftw(h.folder, look, 16, FTW_PHYS);
	snprintf(path, sizeof path, "%s/datasets", h.folder);
	dir = opendir(path);
	while (dir && (e = readdir(dir))) {
		char sub[sizeof path + sizeof e->d_name];

		snprintf(sub, sizeof sub, "%s/%s", path, e->d_name);
		if (*e->d_name != '.')
			look_dataset(sub);
	}
	if (dir)
		closedir(dir);
	return !bad_names;
}

static unsigned open_files(void)
{
	DIR *dir = opendir("/proc/self/fd");
	unsigned n = 0;

	while (readdir(dir))
		n++;
	closedir(dir);
	return n;
}

/* ---- many of them ---- */

static char base[36];

/* All that a test makes is below one folder, in memory if there is such a place. */
static void scene_begin(void)
{
	setvbuf(stdout, NULL, _IOLBF, 0);
	grid_sources_here = 0; /* each push makes a file of sources */
	snprintf(base, sizeof base, "%s/acut-fault-XXXXXX", access("/dev/shm", W_OK) ? "/tmp" : "/dev/shm");
	if (!mkdtemp(base))
		abort();
}

static void scene_end(void)
{
	repeat_remove(base);
}

static void new_folder(unsigned long i)
{
	snprintf(h.folder, sizeof h.folder, "%.35s/%lu", base, i);
	if (mkdir(h.folder, 0700))
		abort();
}

static void drop_folder(void)
{
	repeat_remove(h.folder);
}

static long setting(const char *name, long otherwise)
{
	const char *text = getenv(name);

	return text && *text ? atol(text) : otherwise;
}

static double seconds(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return (double)t.tv_sec + (double)t.tv_nsec / 1e9;
}

enum { AT_ONCE = 4 }; /* they wait more than they work */

/* run(i) for i below n, each in a process of its own, AT_ONCE at a time; how many did not end with 0, or in time. */
static unsigned long each_apart(unsigned long n, void (*run)(unsigned long i), void (*failed)(unsigned long i, int status))
{
	unsigned long bad = 0, begun = 0, ended = 0, index[AT_ONCE] = {0};
	pid_t child[AT_ONCE] = {0};

	fflush(stdout);
	while (ended < n) {
		int status;
		pid_t pid;

		for (int k = 0; k < AT_ONCE; k++) {
			if (child[k] || begun == n)
				continue;
			index[k] = begun++;
			child[k] = fork();
			if (child[k] == 0) {
				alarm(300); /* a hang */
				run(index[k]);
				_exit(0);
			}
		}
		pid = wait(&status);
		for (int k = 0; k < AT_ONCE; k++) {
			if (child[k] != pid)
				continue;
			child[k] = 0;
			ended++;
			if (status) {
				bad++;
				snprintf(h.folder, sizeof h.folder, "%.35s/%lu", base, index[k]);
				drop_folder();
				if (failed)
					failed(index[k], status);
			}
		}
	}
	return bad;
}

#endif
