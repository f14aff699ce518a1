*** Settings ***
Documentation     LS7266R1: the 24-bit counter wraps, the board's position does not.
Library           ForceBoard.py

*** Test Cases ***
Counter And Board Agree
    Armed Board
    Hold For    500
    FOR    ${unit}    IN RANGE    1    7
        Position Should Follow The Counter    ${unit}
    END

Position Goes On Over The Wrap
    Power Up Board
    # 8,388,000 counts, 608 before the sign of 24 bits turns over.
    Execute Command    rig TurnEncoder 1 8388000
    Execute Command    rig TurnEncoder 2 -8388000
    Advance    300
    Connect
    Bring Up Units
    Stream    1
    Advance    100
    ${first}=    Encoder Position    1
    ${second}=    Encoder Position    2
    Execute Command    rig TurnEncoder 1 2000
    Execute Command    rig TurnEncoder 2 -2000
    Advance    100
    ${first_after}=    Encoder Position    1
    ${second_after}=    Encoder Position    2
    Should Be Equal As Integers    ${{$first_after - $first}}    2000
    Should Be Equal As Integers    ${{$second_after - $second}}    -2000
