/* What programs with a command line share: options with a help that is made of their table, errors
   that say what was meant, and what a scene says of itself.

   Include it after itn.h; define PROGRAM, its name, before. */
#ifndef TOOL_H
#define TOOL_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* An option, the name of its value (NULL: it has none), and its help. */
typedef struct tool_option { const char *name, *value, *help; } tool_option;

static void fail(const char *what, const char *why) {
    fprintf(stderr, PROGRAM ": %s%s%s\n", what, *why ? ": " : "", why);
    exit(1);
}

/* How many letters have to be changed, added or left out to make a name of what was given
   (Levenshtein); 0 if that is a part of the name. */
static int tool_distance(const char *a, const char *b) { /* given, name */
    int row[ITN_NAME_SIZE + 1], width = (int)strlen(b), i, k;
    if (a[0] && a[1] && a[2] && strstr(b, a)) return 0;
    if (width > ITN_NAME_SIZE) return width;
    for (k = 0; k <= width; k++) row[k] = k;
    for (i = 0; a[i]; i++) {
        int corner = row[0]++; /* of the rectangle whose other three are row[k - 1], row[k], new */
        for (k = 1; k <= width; k++) {
            int change = corner + (a[i] != b[k - 1]);
            corner = row[k];
            if (row[k - 1] + 1 < change) change = row[k - 1] + 1;
            row[k] = row[k] + 1 < change ? row[k] + 1 : change;
        }
    }
    return row[width];
}

/* Reads argument *i, and its value if it has one, and goes on to the next. Returns which option it
   is, or -1 where it is none, which is then *value. Prints the help if it is asked for. */
static int tool_next(const char *usage, const tool_option *options, int argc, char **argv, int *i,
                     const char **value) {
    const tool_option *o, *meant = NULL;
    const char *argument = *value = argv[(*i)++];
    char text[160];
    int least = 4;
    if (!strcmp(argument, "--help") || !strcmp(argument, "-h")) {
        printf("usage: %s", usage);
        for (o = options; o->name; o++)
            printf("  %s %s%*s%s\n", o->name, o->value ? o->value : "",
                   (int)(32 - strlen(o->name) - (o->value ? strlen(o->value) : 0)), "", o->help);
        exit(0);
    }
    if (argument[0] != '-') return -1;
    for (o = options; o->name && strcmp(o->name, argument) != 0; o++) {
        int distance = tool_distance(argument, o->name);
        if (distance < least) least = distance, meant = o;
    }
    snprintf(text, sizeof text, "there is no such option; %s %s", meant ? "did you mean" : "see",
             meant ? meant->name : "--help");
    if (!o->name) fail(argument, text);
    snprintf(text, sizeof text, "needs a value: %s", o->value ? o->value : "");
    if (o->value && *i == argc) fail(argument, text);
    if (o->value) *value = argv[(*i)++];
    return (int)(o - options);
}

/* A number in a range, or the end of the program. */
static double tool_number(const char *option, const char *text, double lowest, double largest) {
    char *end, why[120];
    double value = strtod(text, &end);
    snprintf(why, sizeof why, "'%.40s' is no number from %g to %.12g", text, lowest, largest);
    if (end == text || *end || !(value >= lowest && value <= largest)) fail(option, why);
    return value;
}
static int tool_whole(const char *option, const char *text, int lowest) {
    double value = tool_number(option, text, lowest, 2147483647);
    if (value != (double)(int)value) fail(option, "needs a whole number");
    return (int)value;
}

/* Which of the words, separated by |, a text is. */
static int tool_choice(const char *option, const char *words, const char *text) {
    size_t size = strlen(text), length;
    const char *word = words;
    char why[120];
    int i;
    for (i = 0; *word; i++, word += length + (word[length] == '|')) {
        length = strcspn(word, "|");
        if (length == size && !memcmp(word, text, size)) return i;
    }
    snprintf(why, sizeof why, "is one of %s", words);
    fail(option, why);
    return -1;
}

/* Fails because a name is of none of the scene's parameters, and says which may be meant. */
static void tool_fail_parameter(const itn_scene *scene, const char *name) {
    int i, least = 8, distance;
    const char *meant = NULL, *known;
    fprintf(stderr, PROGRAM ": the scene has no parameter %s; there are", name);
    for (i = 0; i < itn_parameter_count(scene); i++) {
        known = itn_parameter_get(scene, i)->name;
        fprintf(stderr, " %s", known);
        distance = tool_distance(name, known);
        if (distance < least) least = distance, meant = known;
    }
    if (meant) fprintf(stderr, "\ndid you mean %s?", meant);
    fprintf(stderr, "\n");
    exit(1);
}

/* Whether a parameter is FIELD of its item, in one of its channels or in all. */
static int tool_is_field(const itn_parameter *p, const char *field) {
    const char *name = strchr(p->name, '.') + 1;
    size_t size = strlen(field);
    return !strncmp(name, field, size) && (!name[size] || (name[size] == '_' && !name[size + 2]));
}

/* Finds the medium of the first parameter, from *i on, that is a sigma_t, and goes on behind it.
   Returns 0 if there is none. */
static int tool_next_medium(const itn_scene *scene, int *i, char medium[ITN_NAME_SIZE]) {
    const itn_parameter *p;
    size_t length;
    while ((p = itn_parameter_get(scene, (*i)++)) != NULL) {
        const char *end = p->name + strlen(p->name);
        if (!tool_is_field(p, "sigma_t") || (end[-2] == '_' && strchr("gb", end[-1]))) continue;
        length = (size_t)(strchr(p->name, '.') - p->name);
        memcpy(medium, p->name, length), medium[length] = 0;
        return 1;
    }
    return 0;
}

/* Says how thick each medium's objects are, in mean free paths: what a picture can tell of sigma_t
   depends on it. */
static void tool_show_thickness(const itn_scene *scene, FILE *file) {
    char medium[ITN_NAME_SIZE];
    int i = 0;
    while (tool_next_medium(scene, &i, medium))
        fprintf(file, "%s: optical thickness %.3g (sigma_t times the mean chord)\n", medium,
                itn_scene_thickness(scene, NULL, medium));
}

#endif
