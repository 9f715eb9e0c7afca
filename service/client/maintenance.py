"""`talus backup`, `talus restore`, `talus retention`: for whoever keeps the installation.

What opens the database is imported by the commands that do: SQLAlchemy is half of what a command's start costs.
"""

from __future__ import annotations

from pathlib import Path

import click

from service.domain.files import LARGE_KINDS
from service.installation_lock import find_running
from service.settings import StartupError, get_settings

FILE = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.argument("file", type=FILE)
def backup(file: Path) -> None:
    """Write the whole installation (rows and stored files) into FILE, a tar. The service may run meanwhile."""
    from service.backup import BackupError, make_backup

    try:
        click.echo(f"{file}: {make_backup(get_settings(), file.resolve()).sentence()}")
    except BackupError as error:
        raise click.ClickException(str(error)) from error


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
def restore(file: Path) -> None:
    """Put the backup FILE into an installation that holds nothing yet."""
    from service.backup import BackupError, restore_backup

    settings = get_settings()
    running = find_running(settings)
    if running is not None:
        raise StartupError(f"{settings.data_dir} is in use by process {running.pid}: stop it first")
    try:
        click.echo(f"{settings.data_dir}: {restore_backup(settings, file.resolve()).sentence()}")
    except BackupError as error:
        raise click.ClickException(str(error)) from error


@click.command()
@click.option(
    "--older-than", type=click.FloatRange(0.0), default=90.0, show_default=True, help="days since the end"
)
@click.option(
    "--kind", "kinds", multiple=True, help=f"kinds of files that may go [default: {', '.join(LARGE_KINDS)}]"
)
@click.option("--delete", is_flag=True, help="remove them; without, they are only listed")
def retention(older_than: float, kinds: tuple[str, ...], delete: bool) -> None:
    """List stored files that may go, or remove them. Rows, with every number, stay."""
    from service.db.session import Database
    from service.retention import Rule, find_removable, remove

    settings = get_settings()
    database = Database(settings.resolved_database_url)
    found = find_removable(database, settings, Rule(older_than, kinds or LARGE_KINDS))
    database.dispose()
    for item in found:
        click.echo(f"{item.size_bytes:12,d}  {item.reason:30}  {item.place}")
    size = remove(found) if delete else sum(item.size_bytes for item in found)
    verb = "removed" if delete else "would go (nothing was removed; --delete removes them)"
    click.echo(f"{len(found)} files, {size / 1e6:.1f} MB {verb}")
