/* Files of settings. Names of the room: config_. */
#ifndef CONFIG_FILE_H
#define CONFIG_FILE_H

#include <stdbool.h>
#include <stddef.h>

struct config;
struct config_told;

/* The lines of a file into *to; errors and warnings are told with `path` and line, and the other lines taken. Any bytes. */
void config_text(const char *path, const char *text, size_t n, struct config *to, struct config_told *);
/* One file. `must`: an error if it is not there. False: it is not there. */
bool config_file(const char *path, bool must, struct config *to, struct config_told *);
/* All *.conf in a folder, by name; none if there is no folder. Hidden files and other names are left. */
void config_folder(const char *path, struct config *to, struct config_told *);

#endif
