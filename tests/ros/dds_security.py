# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A DDS with security beside that of the wheels: Eclipse Cyclone DDS of Debian and Ubuntu.

What `ros2 security` makes of a policy is made here with openssl: identities, and permissions in
the names that ROS 2 gives topics and services on the wire (`rt/...`, `rq/...Request`).
"""

import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from pathlib import Path

SOURCES = Path(__file__).with_name("dds")
_LOOPBACK = """<General><AllowMulticast>false</AllowMulticast>
 <Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>
 <Peers><Peer address="127.0.0.1"/></Peers></Discovery>"""


def build(folder: Path) -> Path:
    """Compile a participant and return its path."""
    _run("idlc", SOURCES / "Float64.idl", folder=folder)
    _run(
        "cc",
        "-I.",
        SOURCES / "participant.c",
        "Float64.c",
        "-o",
        "participant",
        "-lddsc",
        folder=folder,
    )
    return folder / "participant"


class Keystore:
    """A certificate authority and what it has signed, for one domain."""

    def __init__(self, folder: Path, domain: int) -> None:
        self._folder, self._domain = folder, domain
        self._key("ca.key")
        self._openssl(
            "req",
            "-x509",
            "-new",
            "-key",
            "ca.key",
            "-subj",
            "/CN=ca",
            "-days",
            "99",
            "-out",
            "ca.pem",
        )
        self._sign("governance", "governance.xml", domain=domain)

    def enclave(
        self, name: str, publish: Iterable[str], subscribe: Iterable[str]
    ) -> str:
        """Make an identity with permissions; return the settings of Cyclone DDS for it."""
        stem = name.strip("/")
        self._key(f"{stem}.key")
        subject = "/CN=" + name.replace("/", r"\/")
        self._openssl(
            "req",
            "-new",
            "-key",
            f"{stem}.key",
            "-subj",
            subject,
            "-out",
            f"{stem}.csr",
        )
        self._openssl(
            "x509",
            "-req",
            "-in",
            f"{stem}.csr",
            "-CA",
            "ca.pem",
            "-CAkey",
            "ca.key",
            "-CAcreateserial",
            "-days",
            "99",
            "-out",
            f"{stem}.pem",
        )
        self._sign(
            stem,
            "permissions.xml",
            name=name,
            domain=self._domain,
            publish=_topics(publish),
            subscribe=_topics(subscribe),
        )
        return settings(f"""<Security>
 <Authentication>{_library("authentication", "auth")}
  <IdentityCertificate>{self._uri(f"{stem}.pem")}</IdentityCertificate>
  <IdentityCA>{self._uri("ca.pem")}</IdentityCA>
  <PrivateKey>{self._uri(f"{stem}.key")}</PrivateKey></Authentication>
 <Cryptographic>{_library("crypto", "crypto")}</Cryptographic>
 <AccessControl>{_library("access_control", "ac")}
  <Governance>{self._uri("governance.p7s")}</Governance>
  <PermissionsCA>{self._uri("ca.pem")}</PermissionsCA>
  <Permissions>{self._uri(f"{stem}.p7s")}</Permissions></AccessControl>
</Security>""")

    def _uri(self, name: str) -> str:
        return f"file:{self._folder / name}"

    def _key(self, name: str) -> None:
        self._openssl(
            "ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", name
        )

    def _sign(self, stem: str, template: str, **values: object) -> None:
        text = (SOURCES / template).read_text().format(**values)
        (self._folder / f"{stem}.xml").write_text(text)
        self._openssl(
            "smime",
            "-sign",
            "-text",
            "-in",
            f"{stem}.xml",
            "-out",
            f"{stem}.p7s",
            "-signer",
            "ca.pem",
            "-inkey",
            "ca.key",
        )

    def _openssl(self, *arguments: str) -> None:
        _run("openssl", *arguments, folder=self._folder)


def settings(security: str = "") -> str:
    """Return the text for CYCLONEDDS_URI: on the loopback interface, with or without security."""
    return f"<CycloneDDS><Domain>{_LOOPBACK}{security}</Domain></CycloneDDS>"


def rules(profile: ElementTree.Element) -> tuple[set[str], set[str]]:
    """What a profile of a policy in the namespace / may publish and subscribe, in DDS names."""
    publish, subscribe = {"ros_discovery_info"}, {"ros_discovery_info"}
    for group in profile:
        (verb,) = group.attrib
        # A request goes the way of what is published, its reply the other way.
        ends = (
            (publish, subscribe)
            if verb in ("publish", "request")
            else (subscribe, publish)
        )
        for item in group:
            names = wire_names(item.tag, full(str(item.text), str(profile.get("node"))))
            for end, name in zip(ends, names, strict=False):
                end.add(name)
    return publish, subscribe


def wire_names(tag: str, name: str) -> list[str]:
    """What DDS calls a topic, or the request and the reply of a service."""
    return [f"rt{name}"] if tag == "topic" else [f"rq{name}Request", f"rr{name}Reply"]


def full(name: str, node: str, namespace: str = "") -> str:
    """A name as ROS expands it for a node."""
    if name.startswith("~"):
        return f"{namespace}/{node}{name[1:]}"
    return name if name.startswith("/") else f"{namespace}/{name}"


def _topics(names: Iterable[str]) -> str:
    return "".join(f"<topic>{name}</topic>" for name in sorted(names))


def _library(function: str, name: str) -> str:
    return (
        f'<Library initFunction="init_{function}" finalizeFunction="finalize_{function}" '
        f'path="dds_security_{name}"/>'
    )


def _run(*command: str | Path, folder: Path) -> None:
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=60)
