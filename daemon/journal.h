/*
 * The journal as the log's sink: entries with message ids and fields.
 */
#ifndef JOURNAL_H
#define JOURNAL_H

/* After log_init, before other threads exist. No effect if stderr is not the journal. name: SYSLOG_IDENTIFIER, borrowed. */
void journal_open(const char *name);

#endif
