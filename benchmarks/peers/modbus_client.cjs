// modbus-serial as a client of the mock PLC: registers, a refused write, a command by its sequence word.
const ModbusRTU = require('modbus-serial');

function say(check, ok, detail = '') { console.log(JSON.stringify({ check, ok, detail: String(detail) })); }

async function main() {
    const client = new ModbusRTU();
    await client.connectTCP(process.argv[2], { port: Number(process.argv[3]) });
    client.setID(1);
    client.setTimeout(2000);
    const { data } = await client.readHoldingRegisters(0, 37);
    say('registers read', data.length === 37 && data[1] === 0xF && (data[1] ^ data[3]) === 0xFFFF, data.slice(0, 4));
    try { await client.writeRegisters(4, [1]); say('a write to a value is refused', false); }
    catch (error) { say('a write to a value is refused', /address/i.test(error.message), error.message); }
    await client.writeRegisters(31, [1, 1, 0]);
    const taken = (await client.readHoldingRegisters(34, 2)).data;
    say('a command is taken once', taken[0] === 1 && taken[1] === 0, taken);
    client.setID(9);
    try { await client.readHoldingRegisters(0, 1); say('an unknown unit is an exception', false); }
    catch (error) { say('an unknown unit is an exception', /gateway/i.test(error.message), error.message); }
    client.close();
}

main().then(() => process.exit(0), (error) => { say('start', false, error); process.exit(1); });
