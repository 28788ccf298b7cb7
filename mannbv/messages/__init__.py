"""What crosses a link: kinds of messages, codecs, and the ledger of their bytes (Sections V-B, VI-D)."""

from mannbv.messages.codec import CODECS, decode, encode
from mannbv.messages.kinds import KINDS, Copies, Grid, Layout, Message, Plan, Profile, Splats, Suggestion, layout
from mannbv.messages.ledger import (
    Ledger,
    Letter,
    Mailbox,
    centralized_bytes,
    ideal_exchange_bytes,
    limited_sharing_bytes,
)

__all__ = [
    "CODECS",
    "KINDS",
    "Copies",
    "Grid",
    "Layout",
    "Ledger",
    "Letter",
    "Mailbox",
    "Message",
    "Plan",
    "Profile",
    "Splats",
    "Suggestion",
    "centralized_bytes",
    "decode",
    "encode",
    "ideal_exchange_bytes",
    "layout",
    "limited_sharing_bytes",
]
