// modbus-serial as a PLC for our driver: the registers of docs/reference/plc.md, a heartbeat, commands taken at once.
const ModbusRTU = require('modbus-serial');

const words = new Array(60).fill(0);
words[1] = 0xF;
words[3] = 0xFFF0;
words[36] = 1;
[20.5, 21, 22, 19, 20, 1002.5, 45].forEach((value, i) => {
    const raw = Buffer.alloc(4);
    raw.writeFloatBE(value);
    words[4 + 2 * i] = raw.readUInt16BE(0);
    words[5 + 2 * i] = raw.readUInt16BE(2);
});
setInterval(() => { words[0] = (words[0] + 1) & 0xFFFF; }, 50);
const server = new ModbusRTU.ServerTCP({
    getHoldingRegister: (address) => words[address],
    setRegister: (address, value) => {
        words[address] = value;
        if (address === 33) { words[34] = words[31]; words[35] = 0; words[2] = value; }
    },
}, { host: '127.0.0.1', port: Number(process.argv[2]), unitID: 1 });
server.on('initialized', () => console.log('ready'));
