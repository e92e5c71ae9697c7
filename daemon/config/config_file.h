/* Files of settings. */
#ifndef CONFIG_FILE_H
#define CONFIG_FILE_H

#include <stdbool.h>
#include <stddef.h>

struct config;
struct config_report;

/* Reads the text of a file into *to. Errors and warnings are reported with path and line; the other lines are used. */
void config_text(const char *path, const char *text, size_t n, struct config *to, struct config_report *);
/* Reads one file. must: its absence is an error. False: it does not exist. */
bool config_file(const char *path, bool must, struct config *to, struct config_report *);
/* Reads all *.conf of a folder in the order of their names, except hidden ones. The folder may be absent. */
void config_folder(const char *path, struct config *to, struct config_report *);

#endif
