#!/usr/bin/python3
"""Writes the fake camera's GenICam description as a C++ string: camera_xml.py OUT.inc

Addresses are those of registers.h."""
import sys

WIDTH, HEIGHT = 2048, 1536
FORMATS = {
    "Mono8": 0x01080001,
    "BayerRG8": 0x01080009,
    "BayerGB8": 0x0108000A,
    "BayerRG10": 0x0110000D,
    "BayerRG12": 0x01100011,
    "BayerRG12p": 0x010C0059,
    "RGB8": 0x02180014,
    "BGR8": 0x02180015,
}
ENUMS = {  # name: (address, {entry: value})
    "PixelFormat": (0x10010, FORMATS),
    "AcquisitionMode": (0x1001C, {"Continuous": 0, "SingleFrame": 1}),
    "TriggerSelector": (0x1005C, {"FrameStart": 0}),
    "TriggerMode": (0x10050, {"Off": 0, "On": 1}),
    "TriggerSource": (0x10054, {"Software": 0, "Line1": 1}),
    "TriggerActivation": (0x100A8, {"RisingEdge": 0, "FallingEdge": 1}),
    "ExposureAuto": (0x10060, {"Off": 0, "Once": 1, "Continuous": 2}),
    "GainAuto": (0x10064, {"Off": 0, "Once": 1, "Continuous": 2}),
    "BalanceWhiteAuto": (0x10068, {"Off": 0, "Once": 1, "Continuous": 2}),
    "BalanceRatioSelector": (0x1006C, {"Red": 0, "Green": 1, "Blue": 2}),
    "LineSelector": (0x100A0, {"Line1": 1, "Line2": 2}),
    "LineMode": (0x100A4, {"Input": 0, "Output": 1}),
    "LineSource": (0x100AC, {"Off": 0, "ExposureActive": 1}),
    "PtpStatus": (0x10094, {"Disabled": 0, "Slave": 1, "Master": 2}),
}
INTEGERS = {  # name: (address, min, max, increment, access)
    "Width": (0x10000, 16, WIDTH, 4, "RW"),
    "Height": (0x10004, 16, HEIGHT, 2, "RW"),
    "OffsetX": (0x10008, 0, WIDTH, 4, "RW"),
    "OffsetY": (0x1000C, 0, HEIGHT, 2, "RW"),
    "PayloadSize": (0x10014, 0, 1 << 30, 1, "RO"),
    "SensorWidth": (0x10098, 0, 65535, 1, "RO"),
    "SensorHeight": (0x1009C, 0, 65535, 1, "RO"),
    "TLParamsLocked": (0x100B0, 0, 1, 1, "RW"),
}
FLOATS = {
    "AcquisitionFrameRate": (0x10020, 1, 200, "Hz"),
    "ExposureTime": (0x10030, 10, 1e6, "us"),
    "Gain": (0x10040, 0, 24, "dB"),
}
COMMANDS = {"AcquisitionStart": (0x10018, 1), "AcquisitionStop": (0x10018, 0), "TriggerSoftware": (0x10058, 1)}


def register(kind, name, address, length, access="RW", more=""):
    return (
        f'<{kind} Name="{name}"><Address>{address:#x}</Address><Length>{length}</Length><AccessMode>{access}'
        f"</AccessMode><pPort>Device</pPort>{more}<Endianess>BigEndian</Endianess></{kind}>"
    )


def description():
    names = [
        *ENUMS,
        *INTEGERS,
        *FLOATS,
        *COMMANDS,
        "BalanceRatio",
        "PtpEnable",
        "AcquisitionFrameRateEnable",
        "GevSCPSPacketSize",
        "GevSCPSFireTestPacket",
    ]
    out = [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<RegisterDescription ModelName="Fake" VendorName="Kinevox" ToolTip="Fake camera of the tests" '
        'StandardNameSpace="GEV" SchemaMajorVersion="1" SchemaMinorVersion="0" SchemaSubMinorVersion="1" '
        'MajorVersion="1" MinorVersion="0" SubMinorVersion="0" ProductGuid="0" VersionGuid="0" '
        'xmlns="http://www.genicam.org/GenApi/Version_1_0" '
        'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">',
        '<Category Name="Root" NameSpace="Standard">'
        + "".join(f"<pFeature>{n}</pFeature>" for n in names)
        + "</Category>",
    ]
    for name, (address, entries) in ENUMS.items():
        out.append(
            f'<Enumeration Name="{name}" NameSpace="Standard">'
            + "".join(
                f'<EnumEntry Name="{e}" NameSpace="Standard"><Value>{v}</Value></EnumEntry>' for e, v in entries.items()
            )
            + f"<pValue>{name}Register</pValue></Enumeration>"
        )
        out.append(
            register(
                "IntReg", name + "Register", address, 4, "RO" if name == "PtpStatus" else "RW", "<Sign>Unsigned</Sign>"
            )
        )
    for name, (address, low, high, step, access) in INTEGERS.items():
        out.append(
            f'<Integer Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue><Min>{low}</Min>'
            f"<Max>{high}</Max><Inc>{step}</Inc></Integer>"
        )
        out.append(register("IntReg", name + "Register", address, 4, access, "<Sign>Unsigned</Sign>"))
    for name, (address, low, high, unit) in FLOATS.items():
        out.append(
            f'<Float Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue><Min>{low}</Min>'
            f"<Max>{high}</Max><Unit>{unit}</Unit></Float>"
        )
        out.append(register("FloatReg", name + "Register", address, 8))
    for name, (address, value) in COMMANDS.items():
        out.append(
            f'<Command Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>'
            f"<CommandValue>{value}</CommandValue></Command>"
        )
        out.append(
            register(
                "IntReg",
                name + "Register",
                address,
                4,
                "WO" if name != "TriggerSoftware" else "RW",
                "<Sign>Unsigned</Sign>",
            )
        )
    for name, address in {"PtpEnable": 0x10090, "AcquisitionFrameRateEnable": 0x100B4}.items():
        out.append(
            f'<Boolean Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue><OnValue>1</OnValue>'
            "<OffValue>0</OffValue></Boolean>"
        )
        out.append(register("IntReg", name + "Register", address, 4, "RW", "<Sign>Unsigned</Sign>"))
    out.append(
        '<Float Name="BalanceRatio" NameSpace="Standard"><pValue>BalanceRatioRegister</pValue><Min>0.1</Min>'
        "<Max>8</Max></Float>"
    )
    out.append(
        '<FloatReg Name="BalanceRatioRegister"><Address>0x10070</Address>'
        '<pIndex Offset="8">BalanceRatioSelectorRegister</pIndex><Length>8</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort><Endianess>BigEndian</Endianess></FloatReg>"
    )
    out.append(
        '<Integer Name="GevSCPSPacketSize" NameSpace="Standard"><pValue>GevSCPSPacketSizeRegister</pValue>'
        "<Min>576</Min><Max>9000</Max><Inc>4</Inc></Integer>"
    )
    out.append(
        '<MaskedIntReg Name="GevSCPSPacketSizeRegister"><Address>0xd04</Address><Length>4</Length>'
        "<AccessMode>RW</AccessMode><pPort>Device</pPort><LSB>31</LSB><MSB>16</MSB><Sign>Unsigned</Sign>"
        "<Endianess>BigEndian</Endianess></MaskedIntReg>"
    )
    out.append(
        '<Command Name="GevSCPSFireTestPacket" NameSpace="Standard"><pValue>GevSCPSFireRegister</pValue>'
        "<CommandValue>1</CommandValue></Command>"
    )
    out.append(
        '<MaskedIntReg Name="GevSCPSFireRegister"><Address>0xd04</Address><Length>4</Length>'
        "<AccessMode>RW</AccessMode><pPort>Device</pPort><Bit>0</Bit><Sign>Unsigned</Sign>"
        "<Endianess>BigEndian</Endianess></MaskedIntReg>"
    )
    out.append('<Port Name="Device" NameSpace="Standard"></Port>')
    out.append("</RegisterDescription>")
    return "\n".join(out)


if __name__ == "__main__":
    with open(sys.argv[1], "w") as file:
        for line in description().splitlines():
            file.write('R"xml(' + line + '\n)xml"\n')
