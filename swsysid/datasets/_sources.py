"""Where the measured files come from: a local copy or a download, both checked by sha256."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path


class MeasuredDataError(OSError):
    """A measured file cannot be had; the message says what to do."""


@dataclass(frozen=True)
class Source:
    """One original file."""

    file: str  # place below SWSYSID_DATA, beginning with the name of the data set
    repository: str  # on GitHub
    commit: str
    paths: tuple[str, ...]  # at which it may lie there, the likeliest first
    sha256: str


def locate(source: Source) -> Path:
    """Path of a verified copy of the file; without one a `MeasuredDataError`."""
    folder = os.environ.get("SWSYSID_DATA")
    if not folder:
        return _download(source)
    path = Path(folder) / source.file
    if not path.is_file():
        raise MeasuredDataError(
            f"SWSYSID_DATA is set but its folder has no {source.file}; copy the file there, or "
            "unset the variable to download it."
        )
    if hashlib.sha256(path.read_bytes()).hexdigest() != source.sha256:
        raise MeasuredDataError(
            f"{source.file} below SWSYSID_DATA differs from the original (sha256); replace it."
        )
    return path


def _download(source: Source) -> Path:
    import pooch

    failures = []
    pooch.get_logger().setLevel("WARNING")
    for path in source.paths:
        try:
            copy = pooch.retrieve(
                f"https://raw.githubusercontent.com/{source.repository}/{source.commit}/{path}",
                known_hash=f"sha256:{source.sha256}",
                fname=source.file.replace("/", "-"),
                path=pooch.os_cache("swsysid"),
            )
            return Path(copy)
        except (OSError, ValueError) as error:  # no connection, not found; wrong checksum
            failures.append(type(error).__name__)
    raise MeasuredDataError(
        f"{source.file} could not be downloaded from github.com/{source.repository} "
        f"({', '.join(failures)}); connect to the internet, or set SWSYSID_DATA to a folder "
        "that holds it."
    )


# --- the files ------------------------------------------------------------------------------

_NEURAL = ("forgi86/sysid-neural-continuous", "956aa7ecd73061b0321c6f6098d74c9e4a7ce67a")
_GAUSSIAN = ("RomanFoell/DRGP-VSS", "457f35ffd321cdfe9359d1df707fde9a32041c9c")
_INCUBATOR = (
    "INTO-CPS-Association/example_digital-twin_incubator",
    "2f08c4f6916258582715e6fc705b4c315d55baaa",
)
_VEHICLE = ("embedded-software-laboratory/cpm_lab", "da0bfa915dfc43c419874a06ec7bfcd6e3efffd1")
_SILVERBOX = ("antonior92/sysid-neuralnet", "8da23c9810f738aececa6058a53e40e9a621e5bc")


def _incubator(folder: str, file: str, sha256: str) -> Source:
    path = f"software/incubator/datasets/{folder}/{file}"
    return Source(f"incubator/original/{folder}_{file}", *_INCUBATOR, (path,), sha256)


_ALL = [
    Source("emps/DATA_EMPS.mat", *_NEURAL, ("examples/EMPS/data/DATA_EMPS.mat",),
           "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e"),
    Source("emps/DATA_EMPS_PULSES.mat", *_NEURAL, ("examples/EMPS/data/DATA_EMPS_PULSES.mat",),
           "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704"),
    Source("cascaded_tanks/dataBenchmark.csv", *_NEURAL, ("examples/CTS/data/dataBenchmark.csv",),
           "ef2388ed822f3aef4aa80d6b0f2b466dd80b361786b3eafc7a2957c31ea323a7"),
    Source("mr_damper/damper.mat", *_GAUSSIAN,
           ("matlab_ip_true/data_raw/damper.mat", "matlab/data_raw/damper.mat"),
           "970ffea9261c05fb738ad66f14628260e817f3de11c38d3c3867dc55c4791cd1"),
    Source("ced_prbs/drive.mat", *_GAUSSIAN,
           ("matlab_ip_true/data_raw/drive.mat", "matlab/data_raw/drive.mat"),
           "47d0825678d854d8a1bbcfb0ad1188026b853f69beb2067ea00cfd88d13dc4ca"),
    Source("silverbox/SNLS80mV.mat", *_SILVERBOX, ("data/SilverboxFiles/SNLS80mV.mat",),
           "5c7413a52255af0cb4e2f93fb6903beb92b08965ba1e6ad0a6ffedfed8477ed4"),
    Source("rc_vehicle/vehicleCommand.csv", *_VEHICLE,
           ("matlab_scripts/vehicle2_model_identification/vehicleCommand.csv",),
           "e26f3db0b5a90b115bc2423a29116a7733a878616bbb7939fdb65cf52cad653f"),
    Source("rc_vehicle/vehicleState.csv", *_VEHICLE,
           ("matlab_scripts/vehicle2_model_identification/vehicleState.csv",),
           "5a5e0a2fed258e995b3e2265919aaa49d8a82ec1981b06d26d6a953306f12561"),
    _incubator("20200918_calibration_fan_24V", "semi_random_movement.csv",
               "5ed02f670a938b9b07a3b5ec0e776fdd0fee1f74849d1eb4c52c4d34dde4982e"),
    _incubator("20201221_controller_tunning", "exp1_ht3_hg2.csv",
               "2c629c44b3bf3b454a4a3ca7b9a92a310e5f2ff7777db3810228a8d8fddb42bf"),
    _incubator("20201221_controller_tunning", "exp2_ht20_hg30.csv",
               "42e96a99f6ee4b3fdd56d34faf14c0256fb2ad16afe341641f48d78ed0237bb4"),
    _incubator("20230501_calibration_empty_system", "20230501_calibration_empty_system.csv",
               "f9a0a4dcc71ba2b5636ab827f43ae6d94cd3d8b64bfb52c363ae48a81dbb14dc"),
]  # fmt: skip

SOURCES = {source.file: source for source in _ALL}
