# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""ROS 2 node that serves the efficiency of a hydromechanical CVT; computes with `hmcvt_core`.

From a message to an answer:

efficiency_node  the executable: arguments, signals, exit codes
node             the node `hmcvt`; its `parameters` and the `qos` of its topics
inputs           the three inputs, and whether each is fresh (`clocks`); `numbering` counts losses
guard            protection against what the network sends; `public_text`: texts that may leave
outputs          answers; `maps` the efficiency map, `diagnostics` the three statuses

From bench messages to a new model:

shafts           readings of a bench message (`frames`: the stage that it names), live or from a bag
recorder         the thread that writes them to the `bench_log`
services         requests and replies; `actions` where the optional hmcvt_msgs is installed
jobs             refits and diagnoses, in the process of `worker`
model_store      models refitted and in service, kept in the `state_folder`
messages         conversion between ROS messages and values of the core; `interfaces` of hmcvt_msgs

`bag` reads recorded bags without ROS; `commands` are what this package adds to the command `hmcvt`.
"""
