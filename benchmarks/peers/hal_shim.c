/* What a kinematics module of LinuxCNC asks of its realtime environment, so that the module can be loaded by itself: pins
   are doubles that `pin` finds by name; nothing is printed. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST 256
static struct { char name[64]; double *value; } pins[MOST];
static int count;

static int add(void **place, const char *name) {
    if (count >= MOST) return -1;
    snprintf(pins[count].name, sizeof pins[count].name, "%s", name);
    *place = pins[count++].value = calloc(1, sizeof(double));
    return 0;
}

static int add_named(void **place, const char *format, va_list rest) {
    char name[64];
    vsnprintf(name, sizeof name, format, rest);
    return add(place, name);
}

double *pin(const char *name) {
    for (int i = 0; i < count; i++)
        if (!strcmp(pins[i].name, name)) return pins[i].value;
    return NULL;
}

int hal_init(const char *name) { (void)name; return 1; }
int hal_exit(int component) { (void)component; return 0; }
int hal_ready(int component) { (void)component; return 0; }
void *hal_malloc(long size) { return calloc(1, (size_t)size); }

#define NEWF(function) \
    int function(int direction, void **place, int component, const char *format, ...) { \
        va_list rest; \
        va_start(rest, format); \
        int status = add_named(place, format, rest); \
        va_end(rest); \
        return (void)direction, (void)component, status; \
    }
NEWF(hal_pin_float_newf)
NEWF(hal_pin_bit_newf)
NEWF(hal_pin_u32_newf)
int hal_pin_bit_new(const char *name, int direction, void **place, int component) {
    return (void)direction, (void)component, add(place, name);
}
int hal_pin_s32_new(const char *name, int direction, void **place, int component) {
    return (void)direction, (void)component, add(place, name);
}
void rtapi_print(const char *format, ...) { (void)format; }
void rtapi_print_msg(int level, const char *format, ...) { (void)level; (void)format; }
