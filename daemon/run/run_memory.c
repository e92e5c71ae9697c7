/* The memory of domains: mapped by the worker that makes one, trimmed to the result, unmapped at the end. */
#include <sys/mman.h>

#include "run_priv.h"

#define HUGE_PAGE ((size_t)2 << 20)
#define PAGE ((size_t)4096)

size_t run_page_round(size_t n)
{
	return (n + PAGE - 1) & ~(PAGE - 1);
}

/* With huge pages the triangulation has few TLB misses. The mapping starts on a huge page and ends with the budget, so no page
 * behind it can become resident. For a small domain they would clear far more memory than it uses, because each array of the
 * arena begins on its own pages. */
static void *memory_map(size_t size, bool huge)
{
	size_t whole = run_page_round(size) + HUGE_PAGE, head;
	uint8_t *base = mmap(NULL, whole, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);

	if (base == MAP_FAILED)
		return NULL;
	head = -(uintptr_t)base & (HUGE_PAGE - 1);
	if (head)
		munmap(base, head);
	munmap(base + head + run_page_round(size), HUGE_PAGE - head);
	madvise(base + head, run_page_round(size), huge ? MADV_HUGEPAGE : MADV_NOHUGEPAGE);
	return base + head;
}

void run_domain_trim(struct run_domain *d, size_t held)
{
	size_t keep = run_page_round(held);

	if (!d->memory || keep >= d->size)
		return;
	munmap((uint8_t *)d->memory + keep, d->size - keep);
	sched_give(d->run->runs->core->p.sched, LEDGER_DOMAIN, d->size - keep);
	d->size = keep;
	if (!keep)
		d->memory = NULL;
}

void run_domain_unmap(struct run_domain *d)
{
	run_domain_trim(d, 0);
}

void run_domain_map(struct run_domain *d, uint64_t bytes)
{
	d->size = run_page_round(bytes);
	d->memory = memory_map(d->size, d->huge);
	if (!d->memory)
		d->r = err_set(&d->err, ERR_NOMEM, "no memory for a domain of %zu bytes", d->size);
}
