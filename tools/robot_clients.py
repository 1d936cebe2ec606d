#!/usr/bin/env python3
"""Drives the simulated controllers of `relight capture controller` with clients that others wrote.

    pip install ur-rtde elirobots elite-ec-sdk      # 1.6.5, 0.0.7 and 0.0.2 were used
    git clone https://github.com/UniversalRobots/RTDE_Python_Client_Library        # 647788c was used
    PYTHONPATH=RTDE_Python_Client_Library python3 tools/robot_clients.py target/release/relight

Starts each controller on the vendor's ports of 127.0.0.1 (most of these clients know no others) and prints a line for each
thing tried. Fails at the first that goes wrong.
"""
import contextlib
import subprocess
import sys
import threading
import time

HOST = "127.0.0.1"
TARGET = [0.2, -1.3, 1.4, -1.6, -1.5, 0.1]


@contextlib.contextmanager
def controller(relight, make, *arguments):
    command = [relight, "capture", "controller", make, "--listen", HOST, *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        ports = {"ur": 4, "ec": 2}[make]
        print(" ".join(command[1:]), "->", ", ".join(process.stdout.readline().strip() for _ in range(ports)))
        yield
    finally:
        process.terminate()
        assert process.wait(5) == 0, "the controller did not end cleanly"


def check(what, condition, value=""):
    print(f"  {'ok' if condition else 'WRONG'}  {what} {value}")
    if not condition:
        sys.exit(1)


def wait(condition, seconds=15):
    until = time.time() + seconds
    while time.time() < until:
        if condition():
            return True
        time.sleep(0.02)
    return False


def near(a, b, tolerance):
    return max(abs(x - y) for x, y in zip(a, b)) < tolerance


def ur_rtde_receive():
    import rtde_receive

    receive = rtde_receive.RTDEReceiveInterface(HOST)
    check("ur-rtde receive: connected, its whole default recipe", receive.isConnected())
    check("robot and safety mode", (receive.getRobotMode(), receive.getSafetyMode()) == (7, 1))
    check("pose of the flange", near(receive.getActualTCPPose()[:3], [-0.4919, -0.1333, 0.4879], 1e-3),
          [round(v, 4) for v in receive.getActualTCPPose()])
    before = receive.getTimestamp()
    time.sleep(0.3)
    check("time goes on", receive.getTimestamp() > before)
    few = rtde_receive.RTDEReceiveInterface(HOST, 125.0, ["actual_q", "runtime_state"])
    check("ur-rtde receive with variables of its own choice", len(few.getActualQ()) == 6)
    few.disconnect()
    return receive


def ur_dashboard():
    import dashboard_client

    dashboard = dashboard_client.DashboardClient(HOST)
    dashboard.connect()
    check("ur-rtde dashboard: connected", dashboard.isConnected())
    check("version", dashboard.polyscopeVersion() != "", dashboard.polyscopeVersion())
    check("in remote control", dashboard.isInRemoteControl())
    check("nothing runs", not dashboard.running() and "STOPPED" in dashboard.programState())
    check("modes", (dashboard.robotmode(), dashboard.safetymode()) == ("Robotmode: RUNNING", "Safetymode: NORMAL"))
    check("model", dashboard.getRobotModel() == "UR5", dashboard.getSerialNumber())
    return dashboard


def ur_script(receive, dashboard):
    import script_client

    script = script_client.ScriptClient(HOST, 5, 12)
    script.connect()
    check("ur-rtde script: connected", script.isConnected())
    joints = ", ".join(str(q) for q in TARGET)
    script.sendScriptCommand(f"def go():\n  movej([{joints}], a=1.2, v=0.8)\nend\n")
    check("a program runs", wait(dashboard.running, 3))
    check("and ends", wait(lambda: not dashboard.running()))
    off = max(abs(a - b) for a, b in zip(receive.getActualQ(), TARGET))
    check("where it was sent, a little beside", 0 < off < 3e-4, f"{off:.1e} rad")
    secondary = script_client.ScriptClient(HOST, 5, 12, 30002)
    secondary.connect()
    secondary.sendScriptCommand("movej([0.0, -1.5708, 1.5708, -1.5708, -1.5708, 0.0], a=1.2, v=0.3)\n")
    check("a line alone runs, by the other port", wait(dashboard.running, 3))
    time.sleep(0.5)
    dashboard.stop()
    check("the dashboard stops it", wait(lambda: not dashboard.running(), 3))
    check("on the way", not near(receive.getActualQ(), TARGET, 1e-3))


def ur_own_client():
    from rtde import rtde

    client = rtde.RTDE(HOST)
    client.connect()
    check("UR's own client: connected, version", client.get_controller_version()[0] == 5)
    names = ["timestamp", "actual_q", "actual_TCP_pose", "runtime_state", "robot_mode", "safety_mode", "robot_status_bits"]
    types = ["DOUBLE", "VECTOR6D", "VECTOR6D", "UINT32", "INT32", "INT32", "UINT32"]
    check("outputs with the types it expects", client.send_output_setup(names, types, 125))
    setpoint = client.send_input_setup(["input_double_register_0", "input_int_register_1"], ["DOUBLE", "INT32"])
    check("inputs with the types it expects", setpoint is not None)
    check("start", client.send_start())
    states = [client.receive() for _ in range(25)]
    check("25 states in order", all(a.timestamp < b.timestamp for a, b in zip(states, states[1:])))
    setpoint.input_double_register_0, setpoint.input_int_register_1 = 1.5, 2
    client.send(setpoint)
    check("states after an input", client.receive() is not None)
    check("pause", client.send_pause())
    client.disconnect()


def elirobots():
    from elite import EC

    robot = EC(ip=HOST, auto_connect=True)
    check("elirobots: connected", robot.connect_state, robot)
    check("version, mode, state", (robot.soft_version, robot.mode.name, robot.state.name) == ("v3.5.2", "REMOTE", "STOP"))
    check("servos", robot.robot_servo_on())
    start = robot.current_joint
    check("joints", near(start, [0, -90, 90, -90, 90, 0, 0, 0], 0.1), [round(q, 3) for q in start])
    check("forward kinematics of them", near(robot.get_forward_kinematic(start), robot.current_pose, 1e-6),
          [round(v, 2) for v in robot.current_pose])
    threading.Thread(target=robot.monitor_run, daemon=True).start()
    check("monitor", wait(lambda: robot.monitor_info.machinePos[0] is not None, 3))
    target = [10, -80, 85, -95, 80, 5, 0, 0]
    check("moveByJoint blocks", robot.move_joint(target, 20))
    check("and arrives", near(robot.current_joint, target, 0.02), [round(q, 3) for q in robot.current_joint])
    check("monitor says the same", wait(lambda: near(robot.monitor_info.machinePos, target, 0.02), 2))
    check("monitor's pose too", near(robot.monitor_info.machinePose, robot.current_pose, 0.01))
    check("a motion without waiting", robot.move_joint(start, 10, block=False) and robot.state.name == "PLAY")
    check("pause, run, stop", robot.pause() and robot.run() and robot.stop())
    check("stands", wait(lambda: robot.state.name == "STOP", 3))
    robot.monitor_run_state = False


def elite_ec_sdk():
    from robot.SDK import Robot

    arm = Robot(HOST)
    check("elite-ec-sdk: connected", arm.connect()[0])
    check("mode and status", (arm.getRobotMode(), arm.getStatus()) == ("REMOTE", "STOP"))
    check("no collision", not arm.getCollisionStatus())
    target = [0, -85, 88, -90, 90, 0]
    check("moveByJoint with six angles", arm.execute("moveByJoint", {"targetPos": target, "speed": 20})[1])
    check("runs", arm.getStatus() == "RUNNING")
    check("and ends", wait(lambda: arm.getStatus() == "STOP"))
    check("where it was sent", near(arm.execute("get_joint_pos")[1], target, 0.02))
    arm.disconnect()


def faults(relight):
    import rtde_receive
    import script_client
    from robot.SDK import Robot

    with controller(relight, "ur", "--fault", "protective-stop@1"):
        receive = rtde_receive.RTDEReceiveInterface(HOST)
        script = script_client.ScriptClient(HOST, 5, 12)
        script.connect()
        script.sendScriptCommand("movej([0.2, -1.3, 1.4, -1.6, -1.5, 0.1])\n")
        check("ur-rtde sees a protective stop", wait(receive.isProtectiveStopped, 5))
    with controller(relight, "ec", "--fault", "leave-remote@1"):
        arm = Robot(HOST)
        arm.connect()
        arm.execute("moveByJoint", {"targetPos": [0, -80, 88, -90, 90, 0], "speed": 50})
        check("elite-ec-sdk sees the mode change", wait(lambda: arm.getRobotMode() == "TEACHING", 5))
        try:
            arm.execute("stop")
            check("elite-ec-sdk knows the error", False)
        except Exception as error:
            check("elite-ec-sdk knows the error", "Remote Mode" in str(error))


def main():
    relight = sys.argv[1]
    with controller(relight, "ur"):
        receive = ur_rtde_receive()
        dashboard = ur_dashboard()
        ur_script(receive, dashboard)
        ur_own_client()
        receive.disconnect()
    with controller(relight, "ec"):
        elirobots()
        elite_ec_sdk()
    faults(relight)
    print("all accepted")


if __name__ == "__main__":
    main()
