/*
 * Every N-th allocation fails, N = 1, 2, ... until there are not so many, while one thing is done to a store that was made
 * before: a push, a replacing one, a revert, a merge, a prune, an import, a change of a dataset, a job, a geoid grid. What must
 * hold: whoever asked hears that it is done, or a typed error; what was refused never was, what was acknowledged is there, both
 * at once and after a restart; meshes are made of the points anew, so none is missing; everything works afterwards, and no file
 * is left.
 *
 * ACUT_FAULT_EVERY: how many allocations apart the points are that are tried (1). ACUT_FAULT_ONLY: the case of that name.
 */
#include "scene.h"

#include "copy.h"
#include "no_memory.h"

#include "../crs/geoid.h"

enum { STATE = 4096, PARTS = 8 };

static struct no_memory control;
static char was[STATE], becomes[STATE], prepared[64], mesh_of_job[DIGEST_HEX_SIZE];
static unsigned long every;
static uint64_t job_of_a;

/* ---- what there is ---- */

static char *end_of(char *state)
{
	return state + strlen(state);
}

static struct {
	char text[512];
	bool answered;
} grids;

static void listed(void *token, const struct err *why, const struct geoid_info *list, size_t n)
{
	must(!why);
	*grids.text = 0;
	for (size_t i = 0; i < n; i++)
		snprintf(end_of(grids.text), 80, "geoid %s\n", list[i].name);
	grids.answered = true;
}

static void mesh_anew(struct dataset *d, uint64_t generation, char digest[DIGEST_HEX_SIZE])
{
	struct job_params p = {.dataset = d, .generation = generation, .view = VIEW, .fresh = true, .peer = me};
	int since = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > since);
	must(accepted_job);
	mesh_to(accepted_job, digest);
}

/* Datasets with their rights and the meshes of their newest and oldest generations, removed ones, geoid grids. */
static void state_of(char ret[STATE])
{
	char newest[DIGEST_HEX_SIZE] = "", oldest[DIGEST_HEX_SIZE] = "";
	struct dataset *d[PARTS];
	unsigned n = dataset_list(h.service->datasets, "", &me, PARTS, d);
	struct dataset_info info;

	*ret = 0;
	for (unsigned i = 0; i < n; i++) {
		dataset_info(d[i], &info);
		/* What was staged of a refused push may wait to be taken up. */
		if (!info.generation && !*info.lattice)
			continue;
		if (info.generation) {
			mesh_anew(d[i], 0, newest);
			mesh_anew(d[i], dataset_oldest(d[i]), oldest);
			dataset_info(d[i], &info); /* the first mesh of lines that were imported makes another manifest */
		}
		snprintf(end_of(ret), STATE - strlen(ret), "%s %o %d, %llu: %s, %llu: %s, %u files, %llu points, %s %s\n",
			 info.name, info.mode, info.pinned, (unsigned long long)info.generation, info.generation ? newest : "",
			 (unsigned long long)dataset_oldest(d[i]), info.generation ? oldest : "", info.files,
			 (unsigned long long)info.points, info.lattice, info.crs);
	}
	for (struct dataset *r = dataset_removed_after(h.service->datasets, 0, &me); r;
	     r = dataset_removed_after(h.service->datasets, r->id, &me))
		snprintf(end_of(ret), STATE - strlen(ret), "removed %s\n", r->name);
	grids.answered = false;
	geoid_list(h.service->geoids, &me, listed, NULL);
	turn_until(grids.answered);
	snprintf(end_of(ret), STATE - strlen(ret), "%s", grids.text);
}

/* ---- what is done ---- */

/* Files are made while nothing fails. */
static int file[PARTS];
static char names[PARTS][80];
static unsigned nfiles;

static void ready(const char *name, int fd)
{
	must(fd >= 0);
	snprintf(names[nfiles], sizeof names[nfiles], "%s", name);
	file[nfiles++] = fd;
}

static void no_files(void)
{
	while (nfiles)
		close(file[--nfiles]);
}

static enum err_code pushes(const char *dataset, bool replace, bool commit)
{
	struct push_params p = {.dataset = dataset, .peer = me, .calls = &calls, .says = {.assume = {"EPSG:25832"}}};
	struct push_input input = {.name = names[0], .path = names[0], .checksum = true, .replace = replace};

	memset(&got, 0, sizeof got);
	ask(push_begin(h.service->pushes, &p, NULL));
	if (!got.why.code)
		ask(push_probe(got.push, dup(file[0]), &input, NULL));
	if (!got.why.code)
		ask(push_plan(got.push, NULL));
	if (!got.why.code && got.known == PUSH_NEW)
		ask(push_file(got.push, dup(file[0]), &input, NULL));
	if (!got.why.code && commit)
		ask(push_commit(got.push, NULL));
	push_end();
	return got.why.code;
}

static void push_seed(const char *dataset, unsigned seed, const char *as)
{
	ready(as, text_file(POINTS, seed));
	must(!pushes(dataset, false, true));
	no_files();
}

static void nothing_there(void) {}

static enum err_code do_create(void);
static void made_there(void)
{
	must(!do_create());
}

static void one_there(void)
{
	push_seed("a", 1, "1.xyz");
}

static void two_there(void)
{
	one_there();
	push_seed("a", 2, "2.xyz");
}

static void three_there(void)
{
	two_there();
	push_seed("a", 3, "3.xyz");
}

static void ready_new(void)
{
	ready("4.xyz", text_file(POINTS, 4));
}

/* Under the name of one that is there. */
static void ready_other(void)
{
	ready("1.xyz", text_file(POINTS, 5));
}

static enum err_code do_push(void)
{
	return pushes("a", false, true);
}

static enum err_code do_replace(void)
{
	return pushes("a", true, true);
}

static enum err_code do_revert(void)
{
	ask(dataset_revert(dataset_find(h.service->datasets, "a", &me), 0, &me, reverted, NULL));
	return got.why.code;
}

static enum err_code do_prune(void)
{
	ask(dataset_prune(dataset_find(h.service->datasets, "a", &me), 1, 0, &me, pruned, NULL));
	return got.why.code;
}

/* A generation that is gone from the points, too. */
static void undone_there(void)
{
	two_there();
	must(!do_revert());
}

/* Left before its commit: its file is durable. */
static void pending_there(void)
{
	ready_new();
	must(!pushes("a", false, false));
	no_files();
}

static void one_and_pending_there(void)
{
	one_there();
	pending_there();
}

static void ready_lines(void)
{
	ready("3.txt", lines_file(8, 3));
}

static void push_seed_lines(const char *as, unsigned seed)
{
	ready(as, lines_file(8, seed));
	must(!pushes("a", false, true));
	no_files();
}

static void lines_there(void)
{
	one_there();
	push_seed_lines("1.txt", 1);
	push_seed_lines("2.txt", 2);
}

/* Of lines that were never alone. */
static enum err_code do_revert_lines(void)
{
	ask(dataset_revert(dataset_find(h.service->datasets, "a", &me), 2, &me, reverted, NULL));
	return got.why.code;
}

/* As an export would bring it: the manifest, and each file that it names. */
static void ready_import(void)
{
	struct dataset *a = dataset_find(h.service->datasets, "a", &me);
	struct grid_manifest *m = NULL;
	struct grid_named_at at = {0};
	struct grid_named named;
	struct err err = ERR_INIT;
	char path[128];
	int dirfd;

	snprintf(path, sizeof path, "%s/datasets/%llu", h.folder, (unsigned long long)a->id);
	dirfd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	must(!grid_manifest_read(dirfd, a->manifest, &m, &err));
	ready("manifest", openat(dirfd, a->manifest, O_RDONLY | O_CLOEXEC));
	while (grid_manifest_next_file(m, &at, &named))
		ready(named.name, openat(dirfd, named.name, O_RDONLY | O_CLOEXEC));
	grid_manifest_free(m);
	close(dirfd);
}

static struct import *importing;

static void import_begun(void *token, const struct err *why, struct import *i)
{
	importing = why ? NULL : i;
	answer(why);
}

static void import_filed(void *token, const struct err *why)
{
	answer(why);
}

static void import_done(void *token, const struct err *why, const struct imported *done)
{
	answer(why);
}

static enum err_code do_import(void)
{
	memset(&got, 0, sizeof got);
	ask(import_begin(h.service->copies, "i", 0644, &me, import_begun, NULL));
	for (unsigned i = 0; !got.why.code && i < nfiles; i++)
		ask(import_file(importing, names[i], dup(file[i]), import_filed, NULL));
	if (!got.why.code)
		ask(import_commit(importing, import_done, NULL));
	if (importing)
		import_end(importing);
	importing = NULL;
	return got.why.code;
}

static enum err_code change(enum dataset_action what, const char *as, const char *mode)
{
	struct dataset_action_params w = {.action = what, .name = "a", .as = as, .mode = mode, .peer = me};

	ask(dataset_act(h.service->datasets, &w, verbed, NULL));
	return got.why.code;
}

static enum err_code do_remove(void)
{
	return change(DATASET_REMOVE, "", NULL);
}

static void removed_there(void)
{
	one_there();
	must(!do_remove());
}

/* Its time is over. Nobody waits to hear that it is gone. */
static enum err_code do_expire(void)
{
	service_set_limits(h.service, &(struct core_limits){.keep_removed = 1e-6});
	return 0;
}

static enum err_code do_restore(void)
{
	return change(DATASET_RESTORE, "r", NULL);
}

static enum err_code do_chmod(void)
{
	return change(DATASET_CHMOD, "", "0600");
}

static void created(void *token, const struct err *why)
{
	answer(why);
}

static enum err_code do_create(void)
{
	struct dataset_create_params w = {.name = "a", .scale_xy = "0.01", .scale_z = "0.01", .crs = "EPSG:25832", .peer = me};

	ask(dataset_create(h.service->datasets, &w, created, NULL));
	return got.why.code;
}

static enum err_code job_at(uint64_t generation)
{
	struct job_params p = {.dataset = dataset_find(h.service->datasets, "a", &me),
			       .generation = generation,
			       .view = VIEW,
			       .fresh = true,
			       .peer = me};
	int since = accepts;

	job_of_a = 0;
	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > since);
	if (accepted_job)
		job_of_a = info_of(accepted_job).id;
	return accepted_err.code;
}

static enum err_code do_job(void)
{
	return job_at(0);
}

/* Its line set is not there any more. */
static enum err_code do_job_before(void)
{
	return job_at(2);
}

static void geoid_answered(void *token, const struct err *why, const struct geoid_info *list, size_t n)
{
	must(why || !token || n == 1);
	answer(why);
}

static void ready_geoid(void)
{
	char *path = geoid_synthetic(36, 19);

	ready("g.pgm", open(path, O_RDONLY | O_CLOEXEC));
	unlink(path);
	free(path);
}

static enum err_code do_geoid(void)
{
	ask(geoid_add(h.service->geoids, dup(file[0]), "g", "g.pgm", &me, geoid_answered, "one"));
	return got.why.code;
}

static void geoid_there(void)
{
	ready_geoid();
	must(!do_geoid());
	no_files();
}

static enum err_code do_geoid_rm(void)
{
	ask(geoid_remove(h.service->geoids, "g", &me, geoid_answered, NULL));
	return got.why.code;
}

static const struct deed {
	const char *name;
	void (*prepare)(void);
	void (*ready)(void); /* NULL: nothing */
	enum err_code (*act)(void);
} deeds[] = {
	{"first push", nothing_there, ready_new, do_push},
	{"first push of a made one", made_there, ready_new, do_push},
	{"first push, taken up", pending_there, ready_new, do_push},
	{"push", one_there, ready_new, do_push},
	{"push, taken up", one_and_pending_there, ready_new, do_push},
	{"push and merge", three_there, ready_new, do_push},
	{"replace", two_there, ready_other, do_replace},
	{"revert", two_there, NULL, do_revert},
	{"push of lines", lines_there, ready_lines, do_push},
	{"revert of lines", lines_there, NULL, do_revert_lines},
	{"job with old lines", lines_there, NULL, do_job_before},
	{"import of lines", lines_there, ready_import, do_import},
	{"prune", undone_there, NULL, do_prune},
	{"import", two_there, ready_import, do_import},
	{"remove", one_there, NULL, do_remove},
	{"expire", removed_there, NULL, do_expire},
	{"restore", removed_there, NULL, do_restore},
	{"chmod", one_there, NULL, do_chmod},
	{"create", nothing_there, NULL, do_create},
	{"job", two_there, NULL, do_job},
	{"geoid add", nothing_there, ready_geoid, do_geoid},
	{"geoid rm", geoid_there, NULL, do_geoid_rm},
};
static const struct deed *deed;

/* ---- points ---- */

static void at_rest(void)
{
	turn_until(!service_active(h.service));
}

static void prepare(void)
{
	new_folder(999999);
	open_service(SCENE_MEMORY, 2);
	deed->prepare();
	at_rest();
	close_service();
	snprintf(prepared, sizeof prepared, "%s", h.folder);
}

static void copy_prepared(unsigned long i)
{
	char command[192];

	snprintf(h.folder, sizeof h.folder, "%.35s/%lu", base, i);
	snprintf(command, sizeof command, "cp -a %s %s", prepared, h.folder);
	must(!system(command));
}

/* The deed, with all that follows from it, while the n-th allocation fails. */
static enum err_code act(uint64_t n)
{
	enum err_code r;

	job_of_a = 0;
	if (deed->ready)
		deed->ready();
	at_rest();
	got.why = accepted_err = ERR_INIT;
	atomic_store(&control.count, 0);
	atomic_store(&control.failed, 0);
	atomic_store(&control.at, n);
	r = deed->act();
	at_rest();
	atomic_store(&control.at, 0);
	no_files();
	return r;
}

/* How many there are when none fails. */
static uint64_t count(void)
{
	copy_prepared(0);
	open_service(SCENE_MEMORY, 2);
	state_of(was);
	must(!act(UINT64_MAX));
	if (job_of_a)
		mesh_to(job_find(h.service->jobs, job_of_a, &me), mesh_of_job);
	state_of(becomes);
	close_service();
	drop_folder();
	return control.count;
}

static void same_state(const char *want, const char *when)
{
	char state[STATE];

	state_of(state);
	if (strcmp(state, want))
		printf("%s, want:\n%sis:\n%s", when, want, state);
	must(!strcmp(state, want));
}

/* One that was to be gone for good, and is there after a restart all the same, is whole. */
static bool is_back(void)
{
	char state[STATE];

	if (deed->act != do_expire || !dataset_removed_after(h.service->datasets, 0, &me))
		return false;
	must(!change(DATASET_RESTORE, "", NULL));
	state_of(state);
	must(strstr(state, "3000 points"));
	return true;
}

static void same_job(void)
{
	struct job *job = job_of_a ? job_find(h.service->jobs, job_of_a, &me) : NULL;
	char digest[DIGEST_HEX_SIZE];

	if (!job_of_a)
		return;
	must(job);
	if (info_of(job).state == JOB_failed) {
		must(info_of(job).err->code == ERR_NOMEM && *info_of(job).err->message);
		return;
	}
	mesh_to(job, digest);
	must(!strcmp(digest, mesh_of_job));
}

static void one_point(unsigned long i)
{
	unsigned fds = open_files();
	const struct err *why = deed->act == do_job || deed->act == do_job_before ? &accepted_err : &got.why;
	enum err_code r;

	copy_prepared(i);
	open_service(SCENE_MEMORY, 2);
	r = act(1 + i * every);
	if (r && ((r != ERR_NOMEM && r != ERR_BUSY && r != ERR_IO) || !*why->message)) {
		printf("no good error: %d \"%s\"\n", (int)r, why->message);
		_exit(1);
	}
	same_state(r ? was : becomes, "at once");
	same_job();
	close_service();
	open_service(SCENE_MEMORY, 2);
	if (!is_back())
		same_state(r ? was : becomes, "after a restart");
	same_job();
	push_seed("z", 9, "9.xyz");
	at_rest();
	close_service();
	must(open_files() == fds);
	drop_folder();
}

static void tell(unsigned long i, int status)
{
	printf("%s, allocation %lu: status %x\n", deed->name, 1 + i * every, status);
}

int main(void)
{
	const char *only = getenv("ACUT_FAULT_ONLY");
	unsigned long points = 0, findings = 0;
	double begun = seconds();

	log_init("memory", setting("ACUT_FAULT_LOG", 0) ? LOG_LEVEL_INFO : LOG_LEVEL_ERROR);
	every = (unsigned long)setting("ACUT_FAULT_EVERY", 1);
	no_memory = &control;
	scene_begin();
	for (deed = deeds; deed < deeds + sizeof deeds / sizeof *deeds; deed++) {
		unsigned long n, bad;

		if (only && strcmp(only, deed->name))
			continue;
		prepare();
		n = (unsigned long)(count() + every - 1) / every;
		bad = n ? each_apart(n, one_point, tell) : 1;
		printf("%-26s %4lu points, %lu findings\n", deed->name, n, bad);
		points += n;
		findings += bad;
		snprintf(h.folder, sizeof h.folder, "%s", prepared);
		drop_folder();
	}
	printf("%lu allocations failed: %lu findings, %.1f s\n", points, findings, seconds() - begun);
	scene_end();
	return findings != 0;
}
