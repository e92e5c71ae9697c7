/* Streams of a job's mesh, for this room. Loop. */
#ifndef JOB_FETCH_H
#define JOB_FETCH_H

#include "job.h"

void job_fetch_attach(struct job *); /* gives the first waiting stream of a bound job to its new run */
void job_fetch_settle(struct job *);
void job_fetch_tick(struct job *);
void job_fetch_park(struct job *);

#endif
