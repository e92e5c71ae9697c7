/*
 * The same result in any order: which task runs next is drawn from a seed (sched_queue_choice), with one, two and four
 * threads. Two pushes at once, jobs of two views at once, all again with an empty cache, all again after a restart: one
 * digest each.
 *
 * ACUT_FAULT_SEEDS: seeds for each number of threads (50); ACUT_FAULT_SEED: the first.
 */
#include "scene.h"

#include "sched_queue.h"

enum { MANY = 40000, WAYS = 3 };

static const unsigned threads_of[WAYS] = {1, 2, 4};
static char want[2][DIGEST_HEX_SIZE];
static uint64_t rng;

static unsigned draw(unsigned n)
{
	rng ^= rng << 13;
	rng ^= rng >> 7;
	rng ^= rng << 17;
	return (unsigned)(rng >> 11) % n;
}

static void remove_below(const char *name)
{
	char path[sizeof h.folder + 16];
	DIR *dir;
	struct dirent *e;

	snprintf(path, sizeof path, "%s/%s", h.folder, name);
	dir = opendir(path);
	while (dir && (e = readdir(dir))) {
		char sub[sizeof path + sizeof e->d_name];

		snprintf(sub, sizeof sub, "%s/%s", path, e->d_name);
		if (*e->d_name != '.')
			repeat_remove(sub);
	}
	if (dir)
		closedir(dir);
}

static struct job *fresh(struct dataset *d, const char *view)
{
	struct job_params p = {.dataset = d, .view = view, .fresh = true, .peer = me};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	must(accepted_job);
	return accepted_job;
}

/* Both views at once. */
static void meshes(void)
{
	struct dataset *d = dataset_find(h.service->datasets, "a", &me);
	struct job *job[2] = {fresh(d, VIEW), fresh(d, OTHER_VIEW)};
	char digest[DIGEST_HEX_SIZE];

	for (int i = 0; i < 2; i++) {
		mesh_to(job[i], digest);
		must(info_of(job[i]).report->domains > 1 || i);
		if (!*want[i])
			snprintf(want[i], sizeof want[i], "%s", digest);
		must(!strcmp(want[i], digest));
	}
}

static void one_order(unsigned long i)
{
	struct dataset *d[2];
	unsigned threads = threads_of[i % WAYS];

	rng = (i / WAYS + 1 + (uint64_t)setting("ACUT_FAULT_SEED", 0)) * UINT64_C(0x9e3779b97f4a7c15);
	sched_queue_choice = draw;
	new_folder(i);
	open_service(SCENE_MEMORY, threads);
	d[0] = push("a", MANY, 1);
	d[1] = push("a", MANY / 2, 2);
	meshes();
	remove_below("domains");
	remove_below("selected");
	meshes();
	dataset_release(d[0]);
	dataset_release(d[1]);
	turn_until(!service_active(h.service));
	close_service();
	open_service(SCENE_MEMORY, threads);
	remove_below("domains");
	meshes();
	turn_until(!service_active(h.service));
	close_service();
	drop_folder();
}

static void tell(unsigned long i, int status)
{
	printf("%u threads, seed %lu: status %x\n", threads_of[i % WAYS], i / WAYS, status);
}

int main(void)
{
	unsigned long n = (unsigned long)setting("ACUT_FAULT_SEEDS", 50), bad;
	double begun = seconds();

	log_init("orders", LOG_LEVEL_ERROR);
	scene_begin();
	one_order(0); /* what they are */
	bad = each_apart(WAYS * n, one_order, tell);
	printf("%lu orders, 1, 2 and 4 threads, 3 times 2 meshes each: %lu others, %.1f s\n", WAYS * n, bad, seconds() - begun);
	scene_end();
	return bad != 0;
}
