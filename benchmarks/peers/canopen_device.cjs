// A CANopen device of another make, for our drivers: identity, a string, a number, heartbeat.
const { AccessType, DataType, Device } = require('canopen');
const { open } = require('./socketcand.cjs');

async function main() {
    const node = Number(process.argv[4]);
    const bus = await open(process.argv[2], Number(process.argv[3]));
    const device = new Device({ id: node });
    device.addListener('message', (message) => bus.send(message));
    bus.onMessage((message) => device.receive(message));
    device.eds.setIdentity({ vendorId: 0xABCD, productCode: 0x1234, revisionNumber: 2, serialNumber: 77 });
    device.eds.addSdoServerParameter(node, 0x580 + node, 0x600 + node);
    device.eds.setHeartbeatProducerTime(100);
    device.eds.addEntry(0x2000, {
        parameterName: 'Text', dataType: DataType.DOMAIN, accessType: AccessType.READ_WRITE,
    });
    device.eds.addEntry(0x2001, {
        parameterName: 'Number', dataType: DataType.UNSIGNED32, accessType: AccessType.READ_WRITE, defaultValue: 5,
    });
    device.start();
    console.log('ready');
}

main();
