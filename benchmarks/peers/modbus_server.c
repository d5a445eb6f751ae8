/* A PLC on libmodbus for our driver: the registers of docs/reference/plc.md; the heartbeat counts requests. */
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* High word first; libmodbus's own function turns the bytes about on some machines. */
static void put_float(uint16_t *words, float value)
{
    uint32_t raw;
    memcpy(&raw, &value, sizeof raw);
    words[0] = (uint16_t)(raw >> 16);
    words[1] = (uint16_t)raw;
}

int main(int argc, char **argv)
{
    const float values[] = {20.5f, 21.0f, 22.0f, 19.0f, 20.0f, 1002.5f, 45.0f};
    modbus_t *line = modbus_new_tcp("127.0.0.1", argc > 1 ? atoi(argv[1]) : 1502);
    modbus_mapping_t *map = modbus_mapping_new(0, 0, 60, 0);
    uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
    int listener = modbus_tcp_listen(line, 1);
    if (listener < 0 || map == NULL)
        return 1;
    map->tab_registers[1] = 0x000F;
    map->tab_registers[3] = 0xFFF0;
    map->tab_registers[36] = 1;
    for (int i = 0; i < 7; i++)
        put_float(map->tab_registers + 4 + 2 * i, values[i]);
    puts("ready");
    fflush(stdout);
    for (;;) {
        if (modbus_tcp_accept(line, &listener) < 0)
            return 1;
        for (int length; (length = modbus_receive(line, query)) >= 0;) {
            map->tab_registers[0]++;
            if (length > 0)
                modbus_reply(line, query, length, map);
            if (map->tab_registers[31] != map->tab_registers[34]) {
                map->tab_registers[34] = map->tab_registers[31];
                map->tab_registers[2] = map->tab_registers[33];
            }
        }
        modbus_close(line);
    }
}
