// A socketcand client in raw mode: enough to bridge a CANopen stack to a loopback bus.
const net = require('net');

exports.open = function open(host, port) {
    return new Promise((resolve, reject) => {
        const socket = net.connect(port, host);
        const listeners = [];
        let text = '', raw = false;
        socket.setNoDelay(true);
        socket.on('error', reject);
        socket.on('data', (data) => {
            text += data.toString('ascii');
            let end;
            while ((end = text.indexOf('>')) >= 0) {
                const words = text.slice(text.indexOf('<') + 1, end).trim().split(/\s+/);
                text = text.slice(end + 1);
                if (words[0] === 'hi') socket.write('< open can0 >');
                else if (words[0] === 'ok' && !raw) { raw = true; socket.write('< rawmode >'); }
                else if (words[0] === 'ok') setTimeout(() => resolve(bus), 150);
                else if (words[0] === 'frame') {
                    const message = { id: parseInt(words[1], 16), data: Buffer.from(words[3] || '', 'hex') };
                    listeners.forEach((listener) => listener(message));
                }
            }
        });
        const bus = {
            send: ({ id, data }) => {
                const bytes = [...data].map((byte) => byte.toString(16).padStart(2, '0')).join(' ');
                socket.write(`< send ${id.toString(16)} ${data.length} ${bytes} >`);
            },
            onMessage: (listener) => listeners.push(listener),
            close: () => socket.destroy(),
        };
    });
};
