// A CANopen master of another make against the mock drive: identity, SDO, blocks, CiA 402, heartbeat, EMCY.
const { Device, DataType } = require('canopen');
const { open } = require('./socketcand.cjs');

const [host, port, node] = [process.argv[2], Number(process.argv[3]), Number(process.argv[4])];
const { UNSIGNED8: U8, UNSIGNED16: U16, UNSIGNED32: U32, INTEGER8: I8, INTEGER32: I32 } = DataType;
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

function say(check, ok, detail = '') { console.log(JSON.stringify({ check, ok, detail: String(detail) })); }

async function attempt(check, work) {
    try { const [ok, detail] = await work(); say(check, ok, detail); } catch (error) { say(check, false, error); }
}

async function main() {
    const bus = await open(host, port);
    const device = new Device({ id: 0x7E });
    device.addListener('message', (message) => bus.send(message));
    bus.onMessage((message) => device.receive(message));
    device.eds.addSdoClientParameter(node, 0x600 + node, 0x580 + node);
    device.eds.addHeartbeatConsumer(node, 600);
    device.eds.addEmcyConsumer(0x80 + node);
    device.start();
    const read = (index, subIndex, dataType, more = {}) =>
        device.sdo.upload({ deviceId: node, index, subIndex, dataType, timeout: 2000, ...more });
    const write = (index, subIndex, dataType, data, more = {}) =>
        device.sdo.download({ deviceId: node, index, subIndex, dataType, data, timeout: 2000, ...more });

    const states = [];
    let missed = 0;
    device.nmt.on('heartbeat', ({ state }) => states.push(state));
    device.nmt.on('timeout', () => { missed += 1; });
    const emergencies = [];
    device.emcy.on('emergency', ({ em }) => emergencies.push(em.code));

    await attempt('identity 0x1018', async () => {
        const [vendor, product] = [await read(0x1018, 1, U32), await read(0x1018, 2, U32)];
        return [vendor === 0x504B && product === 0x402, `${vendor.toString(16)} ${product.toString(16)}`];
    });
    await attempt('expedited SDO written and read back', async () => {
        await write(0x6081, 0, U32, 20000000);
        return [await read(0x6081, 0, U32) === 20000000, ''];
    });
    const table = Buffer.from(Array.from({ length: 600 }, (_, i) => (7 * i) & 0xFF));
    await attempt('segmented SDO of 600 bytes', async () => {
        await write(0x2101, 1, null, table);
        return [Buffer.compare(await read(0x2101, 1, null), table) === 0, ''];
    });
    await attempt('block download of 600 bytes', async () => {
        const other = Buffer.from(table).reverse();
        await write(0x2102, 1, null, other, { blockTransfer: true });
        return [Buffer.compare(await read(0x2102, 1, null), other) === 0, ''];
    });
    await attempt('block upload of 600 bytes', async () => {
        return [Buffer.compare(await read(0x2101, 1, null, { blockTransfer: true }), table) === 0, ''];
    });
    await attempt('an unknown object is refused', async () => {
        try { await read(0x5555, 0, U32); } catch (error) { return [/06020000|not exist/i.test(String(error)), error]; }
        return [false, 'it was answered'];
    });
    await attempt('heartbeat', async () => {
        await write(0x1017, 0, U16, 100);
        await pause(1500);
        return [states.includes(127) && missed === 0, `states ${states}, missed ${missed} times in 1.5 s`];
    });
    await attempt('NMT start, CiA 402 enable', async () => {
        device.nmt.startNode(node);
        await write(0x6060, 0, I8, 1);
        for (const word of [0x06, 0x07, 0x0F]) await write(0x6040, 0, U16, word);
        const status = await read(0x6041, 0, U16);
        return [(status & 0x6F) === 0x27, status.toString(16)];
    });
    await attempt('CiA 402 move with the set-point handshake', async () => {
        const target = await read(0x6064, 0, I32) + 1000000;
        await write(0x607A, 0, I32, target);
        await write(0x6040, 0, U16, 0x1F);
        const taken = (await read(0x6041, 0, U16)) & 0x1000;
        await write(0x6040, 0, U16, 0x0F);
        for (let i = 0; i < 50 && !((await read(0x6041, 0, U16)) & 0x400); i++) await pause(50);
        const off = await read(0x6064, 0, I32) - target;
        return [Boolean(taken) && Math.abs(off) <= 100, `${off} increments off`];
    });
    await attempt('EMCY', async () => {
        say('make a fault', true);
        for (let i = 0; i < 40 && !emergencies.includes(0x2310); i++) await pause(50);
        return [emergencies.includes(0x2310), emergencies.map((code) => code.toString(16))];
    });
    await attempt('fault state, error history, fault reset', async () => {
        const [status, last] = [await read(0x6041, 0, U16), await read(0x1003, 1, U32)];
        await write(0x6040, 0, U16, 0x00);
        await write(0x6040, 0, U16, 0x80);
        const after = await read(0x6041, 0, U16);
        return [(status & 0x4F) === 0x08 && last === 0x2310 && (after & 0x4F) === 0x40, after.toString(16)];
    });
    device.stop();
    bus.close();
}

main().then(() => process.exit(0), (error) => { say('start', false, error); process.exit(1); });
