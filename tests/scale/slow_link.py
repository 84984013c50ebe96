"""The link between servers and their database: it delays, holds everything back, or is cut.

Usage: slow_link.py FROM TO     sockets; then lines on standard input, each answered by one: `delay SECONDS` (of each direction),
`hang` (nothing passes, connections stay and are accepted), `cut` (connections end, new ones are refused), `mend` (all as at first)
"""
import asyncio
import os
import sys


class Link:
    def __init__(self, source, target):
        self.source, self.target = source, target
        self.delay, self.passes, self.server, self.open = 0.0, asyncio.Event(), None, set()
        self.passes.set()

    async def listen(self):
        self.server = await asyncio.start_unix_server(self.connect, self.source)
        os.chmod(self.source, 0o777)

    async def connect(self, reader, writer):
        try:
            await self.passes.wait()
            there, back = await asyncio.open_unix_connection(self.target)
        except OSError:
            writer.close()
            return
        self.open |= {writer, back}
        await asyncio.gather(self.pump(reader, back), self.pump(there, writer))
        self.open -= {writer, back}

    async def pump(self, reader, writer):
        """What comes is passed on in order, each piece after the delay."""
        pieces = asyncio.Queue()

        async def send():
            while (piece := await pieces.get()) is not None:
                due, data = piece
                await asyncio.sleep(max(0.0, due - asyncio.get_running_loop().time()))
                await self.passes.wait()
                writer.write(data)
                await writer.drain()
            writer.close()

        sending = asyncio.create_task(send())
        try:
            while data := await reader.read(1 << 16):
                pieces.put_nowait((asyncio.get_running_loop().time() + self.delay, data))
        except OSError:
            pass
        pieces.put_nowait(None)
        try:
            await sending
        except OSError:
            pass

    async def obey(self, order, argument):
        if order == "delay":
            self.delay = float(argument)
        elif order == "hang":
            self.passes.clear()
        elif order == "cut":
            self.server.close()
            os.unlink(self.source)
            for writer in list(self.open):
                writer.transport.abort()
        elif order == "mend":
            self.delay = 0.0
            self.passes.set()
            if not self.server.is_serving():
                await self.listen()


async def main():
    link = Link(*sys.argv[1:])
    await link.listen()
    orders = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(orders), sys.stdin)
    print("ready", flush=True)
    while line := (await orders.readline()).decode().split():
        await link.obey(line[0], line[1] if len(line) > 1 else None)
        print("done", flush=True)


if __name__ == "__main__":
    asyncio.run(main())
