"""``trexton data``: public flights. They are listed, or fetched by URL and hash."""

import argparse

from trexton.flights.registry import data_folder, fetch, registry


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    verbs.add_parser("list", help="the names, what they are, and whether they are on this machine")
    get = verbs.add_parser("fetch", help="download, check the SHA-256, write a Flight folder")
    get.add_argument("name", metavar="NAME", help="a name from the list")
    get.add_argument("--out", metavar="DIR", help="where to put it (default: data/flights/NAME)")
    get.add_argument("--replace", action="store_true", help="replace what is there")


def run(arguments: argparse.Namespace) -> int:
    if arguments.verb == "list":
        for name, entry in registry().items():
            here = all((data_folder() / file["key"]).is_file() for file in entry["files"])
            print(f"{name}: {entry['title']}\n  licence: {entry['licence']}")
            print(f"  on this machine: {'yes' if here else 'no'}")
        return 0
    out = arguments.out or f"data/flights/{arguments.name}"
    print(fetch(arguments.name, out, arguments.replace))
    return 0
