/* Streams of a job's mesh: waiting for the job, or runs of their own. Of this room only. */
#ifndef JOB_FETCH_H
#define JOB_FETCH_H

#include "job.h"

void job_fetch_attach(struct job *); /* the job's new run takes the first waiting stream of a bound job */
void job_fetch_settle(struct job *);
void job_fetch_tick(struct job *);
void job_fetch_park(struct job *);

#endif
