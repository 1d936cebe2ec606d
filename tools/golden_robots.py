#!/usr/bin/env python3
"""Golden bytes of robot controllers' protocols for crates/relight-capture/tests/golden/robots.json.

    pip install elirobots elite-ec-sdk      # 0.0.7 and 0.0.2 were used
    git clone https://github.com/UniversalRobots/RTDE_Python_Client_Library        # 647788c was used
    PYTHONPATH=RTDE_Python_Client_Library python3 tools/golden_robots.py > crates/relight-capture/tests/golden/robots.json

Requests are what the clients put on a socket. States are packed by the clients' own descriptions of what they unpack, with a
different number in every field.
"""
import json
import math
import socket
import struct
import sys
import threading

from elite._monitor import ECMonitorInfo
from elite._baseec import BaseEC
from rtde import rtde, serialize

JOINTS = [0.1, -1.2, 1.3, -1.4, -1.5, 0.6]
NAMES = ["timestamp", "actual_q", "robot_mode", "safety_mode", "runtime_state"]
TYPES = ["DOUBLE", "VECTOR6D", "INT32", "INT32", "UINT32"]


def ur():
    """UR's client against a peer that answers just enough."""
    answers = {
        b"V": b"\x01", b"v": struct.pack(">IIII", 5, 12, 6, 1102099), b"O": b"\x01" + ",".join(TYPES).encode(),
        b"I": b"\x01DOUBLE,INT32", b"S": b"\x01", b"P": b"\x01",
    }
    requests = {}
    server = socket.create_server(("127.0.0.1", 0))

    def answer():
        peer, _ = server.accept()
        while header := peer.recv(3):
            size, kind = struct.unpack(">Hc", header)
            payload = peer.recv(size - 3) if size > 3 else b""
            requests[kind.decode()] = (header + payload).hex()
            peer.sendall(struct.pack(">Hc", len(answers[kind]) + 3, kind) + answers[kind])

    threading.Thread(target=answer, daemon=True).start()
    client = rtde.RTDE(*server.getsockname())
    client.connect()
    client.get_controller_version()
    client.send_input_setup(["input_double_register_0", "input_int_register_1"])
    client.send_output_setup(NAMES, TYPES, 125)
    client.send_start()
    client.send_pause()
    client.disconnect()
    recipe = serialize.DataConfig.unpack_recipe(answers[b"O"])
    recipe.names = NAMES
    state = serialize.DataObject.create_empty(NAMES, recipe.id)
    for name, value in zip(NAMES, [1.5, JOINTS, 7, 1, 2]):
        setattr(state, name, value)
    payload = recipe.pack(state)
    frame = struct.pack(">Hc", len(payload) + 3, b"U") + payload
    return {"requests": requests, "answers": {k.decode(): v.hex() for k, v in answers.items()}, "state": frame.hex()}


def elite():
    """A packet by elirobots' description, and the requests of both clients."""
    packet, number = b"", 100
    values = {"machinePos": [math.degrees(q) for q in JOINTS] + [7.0, 8.0], "robotState": [3], "servoReady": [1],
              "robotMode": [2]}
    for name, layout in ECMonitorInfo._ec_struct.items():
        value = values.get(name)
        if value is None:
            value = [number % 250 + i for i in range(len(layout))]
            number += 17
        if name == "MessageSize":
            value = [sum(struct.calcsize("!" + layout) for layout in ECMonitorInfo._ec_struct.values())]
        packet += struct.pack("!" + layout, *value)

    class Recorder:
        def __init__(self, answer):
            self.sent, self.answer = [], answer

        def sendall(self, request):
            self.sent.append(request.decode())

        def recv(self, _):
            return self.answer

    recorder = Recorder(b'{"jsonrpc":"2.0","result":"true","id":1}\n')
    client = BaseEC()
    client.sock_cmd = recorder
    target = [math.degrees(q) for q in JOINTS] + [0.0, 0.0]
    client.send_CMD("getRobotState")
    client.send_CMD("moveByJoint", {"targetPos": target, "speed": 20})
    from robot.SDK import Robot

    client = Robot("127.0.0.1")
    client.sock, client.connect_success = recorder, True
    client.execute("getRobotMode")
    client.execute("moveByJoint", {"targetPos": target[:6], "speed": 20})
    return {"packet": packet.hex(), "requests": recorder.sent}


def main():
    json.dump({"joints": JOINTS, "ur": ur(), "elite": elite()}, sys.stdout, indent=1)
    print()


if __name__ == "__main__":
    main()
