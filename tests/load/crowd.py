"""Connections that are held and hardly used: idle ones, and slow ones that send a head byte by byte or read an answer so.

Usage: crowd.py HOST PORT PATH IDLE SLOW SECONDS. Prints how many of them were still open at the end.
"""
import asyncio
import sys
import time


async def idle(host, port, path, end):
    reader, writer = await asyncio.open_connection(host, port)
    while time.monotonic() < end:  # one request now and then, so that the server has no reason to let go
        writer.write(f"GET /healthz HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        if not await reader.read(4096):
            return False
        await asyncio.sleep(min(15, max(0.1, end - time.monotonic())))
    writer.close()
    return True


async def slow(host, port, path, end):
    """Each second a byte more of a head; the server may close after ten seconds, and then it begins anew."""
    while time.monotonic() < end:
        try:
            _, writer = await asyncio.open_connection(host, port)
            for byte in f"GET {path} HTTP/1.1\r\nHost: {host}\r\nX-Slow: {'x' * 1000}\r\n".encode():
                writer.write(bytes([byte]))
                await writer.drain()
                await asyncio.sleep(1)
                if time.monotonic() > end:
                    break
            writer.close()
        except OSError:
            await asyncio.sleep(0.1)
    return True


async def main():
    host, port, path = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    idle_count, slow_count, seconds = int(sys.argv[4]), int(sys.argv[5]), float(sys.argv[6])
    end = time.monotonic() + seconds
    ended = await asyncio.gather(*(idle(host, port, path, end) for _ in range(idle_count)),
                                 *(slow(host, port, path, end) for _ in range(slow_count)), return_exceptions=True)
    print(sum(result is True for result in ended))


asyncio.run(main())
