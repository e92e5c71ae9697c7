/* Finds the profile of a device: all criteria of a profile must hold; of several matches the most specific one is taken. */
#include <string.h>

#include "profile.h"

/* * matches any bytes, ? one. Linear: after several stars only the last is tried again. */
static bool glob(const char *pattern, const char *text)
{
	const char *star = NULL, *from = text;

	while (*text) {
		if (*pattern == '*') {
			star = ++pattern;
			from = text;
		} else if (*pattern == '?' || *pattern == *text) {
			pattern++;
			text++;
		} else if (star) {
			pattern = star;
			text = ++from;
		} else {
			return false;
		}
	}
	while (*pattern == '*')
		pattern++;
	return !*pattern;
}

/* How specific the match is; 0: it does not match. */
static unsigned match_specificity(const struct profile *p, const struct profile_device *d)
{
	bool class = p->interface_class < 0;

	if ((p->vendor >= 0 && p->vendor != d->vendor) || (p->product >= 0 && p->product != d->product) ||
	    (p->device_class >= 0 && p->device_class != d->device_class) ||
	    (*p->serial && (!d->serial || !glob(p->serial, d->serial))))
		return 0;
	for (size_t i = 0; !class && i < d->interfaces; i++)
		class = d->interface_classes[i] == p->interface_class;
	if (!class)
		return 0;
	return (*p->serial ? 16U : 0) + (p->product >= 0 ? 8U : 0) + (p->vendor >= 0 ? 4U : 0) + (p->device_class >= 0 ? 2U : 0) +
	       (p->interface_class >= 0 ? 1U : 0);
}

const struct profile_entry *profile_set_match(const struct profile_set *set, const struct profile_device *d)
{
	const struct profile_entry *best = NULL;
	unsigned most = 0;

	for (size_t i = 0; i < profile_set_count(set); i++) {
		const struct profile_entry *e = profile_set_at(set, i);
		unsigned n = e->fault ? 0 : match_specificity(&e->profile, d);

		if (n > most) {
			most = n;
			best = e;
		}
	}
	return best;
}
