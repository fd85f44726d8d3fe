# SPDX-License-Identifier: Apache-2.0
"""A DDS with security beside that of the wheels: Eclipse Cyclone DDS of Debian and Ubuntu.

What `ros2 security` makes of a policy is made here with openssl: identities, and permissions in
the names that ROS 2 gives topics and services on the wire (`rt/...`, `rq/...Request`).
"""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from pathlib import Path

# Takes DOMAIN SECONDS and topics with a letter before each: w writes, r reads.
PARTICIPANT = r"""
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include "Float64.h"

int main(int n, char **a) {
  dds_entity_t p = dds_create_participant(atoi(a[1]), NULL, NULL), ends[9];
  int heard[9] = {0};
  for (int i = 3; i < n; i++) {
    dds_entity_t t = dds_create_topic(p, &std_msgs_msg_dds__Float64__desc, a[i] + 1, NULL, NULL);
    ends[i] = t < 0 ? t : a[i][0] == 'w' ? dds_create_writer(p, t, NULL, NULL)
                                         : dds_create_reader(p, t, NULL, NULL);
  }
  for (int round = 0; round < atoi(a[2]) * 20; round++, dds_sleepfor(DDS_MSECS(50)))
    for (int i = 3; i < n; i++) {
      std_msgs_msg_dds__Float64_ message = {round};
      void *taken[1] = {NULL};
      dds_sample_info_t info[1];
      if (ends[i] < 0) continue;
      if (a[i][0] == 'w') dds_write(ends[i], &message);
      else if (dds_take(ends[i], taken, info, 1, 1) == 1) {
        heard[i] += info[0].valid_data;
        dds_return_loan(ends[i], taken, 1);
      }
    }
  for (int i = 3; i < n; i++)
    printf("%s %s\n", a[i], ends[i] == DDS_RETCODE_NOT_ALLOWED_BY_SECURITY ? "refused"
                            : ends[i] < 0 ? "failed" : a[i][0] == 'w' ? "allowed"
                            : heard[i] ? "heard" : "silent");
  return 0;
}
"""
IDL = """module std_msgs { module msg { module dds_ {
  @final struct Float64_ { double data; };
}; }; };
"""

# What `ros2 security create_keystore` writes, for another domain.
GOVERNANCE = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
 <domain_access_rules><domain_rule>
  <domains><id>{domain}</id></domains>
  <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
  <enable_join_access_control>true</enable_join_access_control>
  <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
  <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
  <rtps_protection_kind>ENCRYPT</rtps_protection_kind>
  <topic_access_rules><topic_rule>
   <topic_expression>*</topic_expression>
   <enable_discovery_protection>true</enable_discovery_protection>
   <enable_liveliness_protection>true</enable_liveliness_protection>
   <enable_read_access_control>true</enable_read_access_control>
   <enable_write_access_control>true</enable_write_access_control>
   <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
   <data_protection_kind>ENCRYPT</data_protection_kind>
  </topic_rule></topic_access_rules>
 </domain_rule></domain_access_rules>
</dds>"""
PERMISSIONS = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
 <permissions><grant name="{name}">
  <subject_name>CN={name}</subject_name>
  <validity>
   <not_before>2020-01-01T00:00:00</not_before><not_after>2100-01-01T00:00:00</not_after>
  </validity>
  <allow_rule>
   <domains><id>{domain}</id></domains>
   <publish><topics>{publish}</topics></publish>
   <subscribe><topics>{subscribe}</topics></subscribe>
  </allow_rule>
  <default>DENY</default>
 </grant></permissions>
</dds>"""
_LOOPBACK = """<General><AllowMulticast>false</AllowMulticast>
 <Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>
 <Peers><Peer address="127.0.0.1"/></Peers></Discovery>"""


def build(folder: Path) -> Path:
    """Compile a participant and return its path."""
    (folder / "Float64.idl").write_text(IDL)
    (folder / "participant.c").write_text(PARTICIPANT)
    _run("idlc", "Float64.idl", folder=folder)
    _run("cc", "participant.c", "Float64.c", "-o", "participant", "-lddsc", folder=folder)
    return folder / "participant"


class Keystore:
    """A certificate authority and what it has signed, for one domain."""

    def __init__(self, folder: Path, domain: int) -> None:
        self._folder, self._domain = folder, domain
        self._key("ca.key")
        self._openssl("req", "-x509", "-new", "-key", "ca.key", "-subj", "/CN=ca", "-days", "99",
                      "-out", "ca.pem")
        self._sign("governance", GOVERNANCE.format(domain=domain))

    def enclave(self, name: str, publish: Iterable[str], subscribe: Iterable[str]) -> str:
        """Make an identity with permissions; return the settings of Cyclone DDS for it."""
        stem = name.strip("/")
        self._key(f"{stem}.key")
        subject = "/CN=" + name.replace("/", r"\/")
        self._openssl("req", "-new", "-key", f"{stem}.key", "-subj", subject, "-out", f"{stem}.csr")
        self._openssl("x509", "-req", "-in", f"{stem}.csr", "-CA", "ca.pem", "-CAkey", "ca.key",
                      "-CAcreateserial", "-days", "99", "-out", f"{stem}.pem")
        self._sign(stem, PERMISSIONS.format(
            name=name, domain=self._domain, publish=_topics(publish), subscribe=_topics(subscribe)))
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
        self._openssl("ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", name)

    def _sign(self, stem: str, text: str) -> None:
        (self._folder / f"{stem}.xml").write_text(text)
        self._openssl("smime", "-sign", "-text", "-in", f"{stem}.xml", "-out", f"{stem}.p7s",
                      "-signer", "ca.pem", "-inkey", "ca.key")

    def _openssl(self, *arguments: str) -> None:
        _run("openssl", *arguments, folder=self._folder)


def settings(security: str = "") -> str:
    """Return the text for CYCLONEDDS_URI: on the loopback interface, with or without security."""
    return f"<CycloneDDS><Domain>{_LOOPBACK}{security}</Domain></CycloneDDS>"


def rules(profile: ElementTree.Element) -> tuple[set[str], set[str]]:
    """What a profile of a policy in the namespace / may publish and subscribe, in DDS names."""
    publish, subscribe = {"ros_discovery_info"}, {"ros_discovery_info"}
    for group in profile:
        verb, = group.attrib
        for item in group:
            name = _full(str(item.text), str(profile.get("node")))
            if group.tag == "topics":
                (publish if verb == "publish" else subscribe).add(f"rt{name}")
            else:
                request, reply = f"rq{name}Request", f"rr{name}Reply"
                publish.add(request if verb == "request" else reply)
                subscribe.add(reply if verb == "request" else request)
    return publish, subscribe


def _full(name: str, node: str) -> str:
    if name.startswith("~"):
        return f"/{node}{name[1:]}"
    return name if name.startswith("/") else f"/{name}"


def _topics(names: Iterable[str]) -> str:
    return "".join(f"<topic>{name}</topic>" for name in sorted(names))


def _library(function: str, name: str) -> str:
    return (f'<Library initFunction="init_{function}" finalizeFunction="finalize_{function}" '
            f'path="dds_security_{name}"/>')


def _run(*command: str, folder: Path) -> None:
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=60)
