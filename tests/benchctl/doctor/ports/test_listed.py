from pathlib import Path

from serial.tools.list_ports_common import ListPortInfo

from benchctl.doctor.ports.listed import described, lasting_name, port_findings, seizing_findings


def _adapter() -> ListPortInfo:
    port = ListPortInfo("/dev/ttyUSB0")
    port.vid, port.pid, port.serial_number = 0x0403, 0x6001, "A50285BI"
    port.manufacturer, port.product = "FTDI", "FT232R USB UART"
    return port


def test_an_adapter_is_told_by_its_numbers_and_words() -> None:
    assert described(_adapter()) == "USB 0403:6001 FTDI FT232R USB UART, serial number A50285BI"
    assert described(ListPortInfo("/dev/ttyS0")) == "no USB adapter, or it says nothing"


def test_the_name_that_stays_is_the_link_to_the_device(tmp_path: Path) -> None:
    device, folder = tmp_path / "ttyUSB0", tmp_path / "by-id"
    device.write_text("")
    folder.mkdir()
    (folder / "usb-another").symlink_to(tmp_path / "ttyUSB1")
    (folder / "usb-FTDI_A50285BI-if00").symlink_to("../ttyUSB0")
    assert lasting_name(str(device), folder) == folder / "usb-FTDI_A50285BI-if00"
    assert lasting_name(str(tmp_path / "ttyUSB7"), folder) is None
    assert lasting_name(str(device), tmp_path / "absent") is None


def test_services_that_seize_adapters_are_named(tmp_path: Path) -> None:
    for number, name in ((12, "ModemManager"), (13, "brltty"), (14, "bash")):
        folder = tmp_path / "proc" / str(number)
        folder.mkdir(parents=True)
        (folder / "comm").write_text(f"{name}\n")
        (folder / "cmdline").write_bytes(f"/usr/sbin/{name}\0--quiet\0".encode())
    manager, braille = seizing_findings(tmp_path)
    assert (manager.verdict, braille.verdict) == ("look", "look")
    assert "process 12 (/usr/sbin/ModemManager --quiet) runs" in manager.says
    assert manager.do.startswith("sudo systemctl disable --now ModemManager")
    assert "brltty-udev.service" in braille.do


def test_without_such_services_all_is_well(tmp_path: Path) -> None:
    assert [finding.verdict for finding in seizing_findings(tmp_path)] == ["ok"]
    unit = tmp_path / "usr/lib/systemd/system/brltty-udev.service"
    unit.parent.mkdir(parents=True)
    unit.write_text("")
    assert next(seizing_findings(tmp_path)).says.startswith("is installed: ")


def test_the_ports_of_this_machine_are_listed() -> None:
    found = list(port_findings(serial_wanted=False))
    assert found
    assert {finding.where for finding in found} == {"ports"}
