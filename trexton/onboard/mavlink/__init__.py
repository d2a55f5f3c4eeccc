"""Talking MAVLink. Fixes become messages, and a conversation with an autopilot goes over a link."""
