/*
 * The journal as the log's sink: entries with message ids and fields.
 */
#ifndef JOURNAL_H
#define JOURNAL_H

/* After log_init and before threads. Nothing where stderr is not the journal. `name`: SYSLOG_IDENTIFIER, kept. */
void journal_open(const char *name);

#endif
