"""Talking MAVLink: messages from fixes, the conversation with an autopilot, and the links it goes
over."""
