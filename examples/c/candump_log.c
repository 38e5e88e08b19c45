#include "candump_log.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "report.h"

static bool append(candump_log_t *log, size_t *capacity, const logged_frame_t *logged)
{
    if (log->count == *capacity) {
        size_t grown = *capacity == 0 ? 1024 : 2 * *capacity;
        logged_frame_t *frames =
            (logged_frame_t *)realloc(log->frames, grown * sizeof(*frames));
        if (frames == NULL) {
            return false;
        }
        log->frames = frames;
        *capacity = grown;
    }
    log->frames[log->count++] = *logged;
    return true;
}

static bool read_lines(candump_log_t *log, FILE *file, const char *path, char **line)
{
    size_t capacity = 0, line_size = 0;
    for (size_t number = 1; getline(line, &line_size, file) >= 0; number++) {
        logged_frame_t logged = {.line = number};
        candump_fault_t fault;
        candump_line_t kind = candump_line_read(*line, &logged.record, &fault);
        if (kind == CANDUMP_LINE_FAULT) {
            report("%s, line %zu, column %zu: %s", path, number, fault.column, fault.text);
            return false;
        }
        if (kind == CANDUMP_LINE_RECORD && !append(log, &capacity, &logged)) {
            report("%s is too long for this machine's memory", path);
            return false;
        }
    }
    if (ferror(file)) {
        report_errno("cannot read", path);
        return false;
    }
    if (log->count == 0) {
        report("%s contains no frame", path);
    }
    return log->count > 0;
}

bool candump_log_read(candump_log_t *log, const char *path)
{
    char *line = NULL;
    bool is_standard_input = strcmp(path, "-") == 0;
    FILE *file = is_standard_input ? stdin : fopen(path, "r");
    *log = (candump_log_t){0};
    if (file == NULL) {
        report_errno("cannot read", path);
        report_is_of_file();
        return false;
    }
    bool is_read = read_lines(log, file, path, &line);
    free(line);
    if (!is_standard_input) {
        fclose(file);
    }
    if (!is_read) {
        report_is_of_file();
        candump_log_free(log);
    }
    return is_read;
}

void candump_log_free(candump_log_t *log)
{
    free(log->frames);
    *log = (candump_log_t){0};
}
